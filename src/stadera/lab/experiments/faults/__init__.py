"""Study of faulty logs: how many are weighed correctly, marked, refused, or silently wrong."""
