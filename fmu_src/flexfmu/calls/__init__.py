"""What the commands do, as functions for scripts: files come in, plain data and pictures go out."""
