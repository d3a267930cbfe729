"""Tables as files: CSV and Markdown."""
