"""Calibrate many injectors to one model family: each is a study of its own, made from one template."""
