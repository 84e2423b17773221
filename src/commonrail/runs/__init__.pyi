"""Run folders: written, read, listed."""

from commonrail.runs.fit import calibrate_into as calibrate_into
from commonrail.runs.folder import create_run_folder as create_run_folder
from commonrail.runs.folder import read_run as read_run
from commonrail.runs.folder import write_run as write_run
from commonrail.runs.listing import list_runs as list_runs
