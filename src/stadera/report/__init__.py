"""Tables, figures, pages and JSON, made from results."""
