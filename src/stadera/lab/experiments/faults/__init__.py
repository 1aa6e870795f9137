"""The study of faulty logs: which are weighed right, named, refused, or silently wrong."""
