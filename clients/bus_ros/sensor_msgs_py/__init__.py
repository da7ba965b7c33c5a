"""`sensor_msgs_py` on the bus: point clouds as arrays of NumPy, which is imported when it is needed."""
