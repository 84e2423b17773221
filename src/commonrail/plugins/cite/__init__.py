"""Parts of a run or an injector with their sources, and the works to cite."""
