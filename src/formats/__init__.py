"""Labels in the formats of other tools: writers, and readers where they can be scored."""
