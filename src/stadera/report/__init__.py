"""Tables, plots, pages and JSON of results, made from the results alone."""
