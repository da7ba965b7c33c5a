"""`bus bag`: what is on the bus, into files and back."""
