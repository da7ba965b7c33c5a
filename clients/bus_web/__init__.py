"""The bus in a browser: one small server for the page, for Foxglove, and for turtlesim."""
