"""Errors that commonrail raises, all a `CommonrailError`."""

from commonrail.base.errors import ConfigurationError as ConfigurationError
from commonrail.base.errors import InputError as InputError
from commonrail.base.errors import OutputError as OutputError
from commonrail.base.errors import PluginError as PluginError
from commonrail.base.errors import SimulationError as SimulationError
from commonrail.base.errors import StudyError as StudyError
