"""A statically stable crawl."""
