"""Parts for commonrail; pyproject.toml registers them, and each is imported when it is first asked for."""

from importlib.resources import files

__citation__ = "The commonrail authors: commonrail-example, parts to copy from."

# Files of the catalogue: the object of an entry point is the path of a TOML file, or a function that returns it.
INJECTOR = files(__name__) / "example-injector.toml"
FUEL = files(__name__) / "example-fuel.toml"
METER = files(__name__) / "example_rate_tube.toml"
