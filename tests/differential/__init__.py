"""The same programs under ROS 2's own rclpy and under busd's facade: compares their output.

    programs/<name>.py       a program: the first line of its docstring is its subject; it prints its results
    programs/show.py         their common functions
    recorded/<name>.txt      the output under rclpy
    share/                   definitions of test_msgs, which come with rclpy and not with busd

Every test run compares the facade with the recorded output. `--nightly` compares the recorded output with
rclpy, if `make peers` has installed it. docs/rclpy-differences.md has the intended differences, line by line;
each program with differences has a section there, with the reasons.

    make differential ARGS="NAME ..."            run programs under both, and show the difference
    make differential ARGS="--record NAME ..."   record the output of rclpy, and write the page's lines again
"""
