"""Time beside accuracy: commonrail's own methods and other people's on the same equations, in one record."""
