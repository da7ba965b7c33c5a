"""What a robot is made of: links and joints, read from its description (URDF)."""
