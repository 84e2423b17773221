"""The paper's study: virtual bench, reproduction and its claims."""

TRUTH = "virtual-lino-2016"  # of the virtual test bench, where no other is named
