"""What a run or an injector used, and how to cite it."""
