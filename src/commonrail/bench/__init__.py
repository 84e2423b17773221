"""What `commonrail doctor` looks at."""
