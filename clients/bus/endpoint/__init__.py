"""Publishers and subscriptions as the link and delivery see them: the inside of what users hold."""
