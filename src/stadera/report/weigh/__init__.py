"""A weighing in the terminal and as a page."""
