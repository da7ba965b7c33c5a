"""Small things that know nothing of the bus, nor of its errors."""
