"""One injector stepped by its caller: its state kept and restored, its inputs given step by step, linearised."""
