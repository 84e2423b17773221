"""Many injectors, each calibrated by one study."""
