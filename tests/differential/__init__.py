"""The same programs under ROS 2's own rclpy and under busd's facade, and what both print.

    programs/<name>.py       a program: its docstring's first line says what it asks; it prints what it finds
    programs/show.py         what they share
    recorded/<name>.txt      what rclpy printed
    share/                   definitions of test_msgs, which come with rclpy and not with busd

Every test run compares the facade with what was recorded; `--nightly` compares that with rclpy, where
`make peers` has installed it. What differs on purpose stands in docs/rclpy-differences.md, line by line;
there each program that differs has a section, with sentences that say why.

    make differential ARGS="NAME ..."            run programs under both, and show the difference
    make differential ARGS="--record NAME ..."   keep what rclpy prints, and write the page's lines anew
"""
