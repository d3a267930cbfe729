"""Methods that keep what only some views show, distractors, out of the scene: by masks, or in layers of the views."""
