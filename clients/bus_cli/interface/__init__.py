"""`bus interface`: the definitions of messages, services and actions. No daemon is needed for them."""
