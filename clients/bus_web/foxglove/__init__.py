"""Foxglove's protocol, by which Foxglove, Lichtblick and PlotJuggler look at the bus."""
