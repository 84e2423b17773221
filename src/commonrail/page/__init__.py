"""Live bench: one HTML page that simulates an injector in the browser while its sliders are moved."""
