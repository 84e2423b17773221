"""Virtual sensor: injected quantity of every shot from a measured pressure and the command."""
