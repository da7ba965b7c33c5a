"""How samples leave a publisher and arrive at a subscription, by shared memory and by socket."""
