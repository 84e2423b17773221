"""Tables, charts, pages and notebook display of results."""
