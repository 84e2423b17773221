"""Tables and charts as plain data, numbers as text, and results as notebooks show them; nothing is drawn here."""
