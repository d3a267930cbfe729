"""Water on the lens: drops, rivulets and mist that stay there while the camera moves."""
