"""Results: counts by clip, their bootstrap, one long table of scores, and tables to be shown."""
