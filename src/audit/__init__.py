"""Labels against exact geometry: what the scene truly holds, and how the annotation differs."""
