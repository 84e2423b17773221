"""The paper's study: virtual bench, reproduction and its claims."""
