"""From a message class to bytes and back: names, definitions, schemas, hashes, checks."""
