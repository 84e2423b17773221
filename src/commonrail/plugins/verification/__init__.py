"""Checks of the engines against closed forms, each other and figures from elsewhere."""
