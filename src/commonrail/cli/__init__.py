"""The command `commonrail`: one file per verb, imported when the verb is called."""
