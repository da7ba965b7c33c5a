"""Recording: what there is on the bus, into a bag."""
