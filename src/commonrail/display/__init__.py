"""Tables and charts as plain data, and numbers as text; nothing is drawn here."""
