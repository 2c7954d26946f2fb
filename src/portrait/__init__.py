"""Pictures of the simulated world and of how it is annotated, made with the simulator itself."""
