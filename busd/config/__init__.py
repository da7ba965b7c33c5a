"""The configuration: what busd.toml says, and what is done when it is read again."""
