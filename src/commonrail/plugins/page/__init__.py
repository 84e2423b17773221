"""Page that simulates in the browser."""
