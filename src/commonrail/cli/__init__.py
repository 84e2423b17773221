"""The command `commonrail`: one file per verb. Only typer is imported before a verb runs."""
