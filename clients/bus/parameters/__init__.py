"""Parameters of a node: values, rules, files, services, and the time that they may choose."""
