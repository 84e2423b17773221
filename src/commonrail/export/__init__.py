"""The compiled physics outside Python: machine code of other processors, C libraries, FMUs."""
