"""Readers of foreign formats, each run in a child process with limits of memory and time."""
