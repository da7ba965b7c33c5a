"""Hash and description of classes, so that no program works them out at its start: all of bus.msg, and more.

Made by `make messages`.
"""
# ruff: noqa: E501

from typing import Final

DESCRIBED: Final[dict[str, tuple[str, bytes]]] = {
    "builtin_interfaces/msg/Duration": (
        "RIHS01_e8d009f659816f758b75334ee1a9ca5b5c0b859843261f14c7f937349599d93b",
        b"\x82\xa4root\xbfbuiltin_interfaces/msg/Duration\xa5types\x81\xbfbuiltin_interfaces/msg/Duration\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "builtin_interfaces/msg/Time": (
        "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
        b"\x82\xa4root\xbbbuiltin_interfaces/msg/Time\xa5types\x81\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "geometry_msgs/msg/Accel": (
        "RIHS01_dc448243ded9b1fcbcca24aba0c22f013dae06c354ba2d849571c0a2a3f57ca0",
        b"\x82\xa4root\xb7geometry_msgs/msg/Accel\xa5types\x82\xb7geometry_msgs/msg/Accel\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/AccelStamped": (
        "RIHS01_ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165",
        b"\x82\xa4root\xbegeometry_msgs/msg/AccelStamped\xa5types\x85\xbegeometry_msgs/msg/AccelStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5accel\xa4type\xb7geometry_msgs/msg/Accel\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb7geometry_msgs/msg/Accel\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/AccelWithCovariance": (
        "RIHS01_230d51bd53bc36f260574e73b42941cefe44684753480b6fc330c032c5db5997",
        b"\x82\xa4root\xd9%geometry_msgs/msg/AccelWithCovariance\xa5types\x83\xd9%geometry_msgs/msg/AccelWithCovariance\x82\xa6fields\x92\x82\xa4name\xa5accel\xa4type\xb7geometry_msgs/msg/Accel\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb7geometry_msgs/msg/Accel\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/AccelWithCovarianceStamped": (
        "RIHS01_61c9ad8928e71dd95ce791b2f02809ee2a0bbcc42cd0e4047fd00a822a08e444",
        b"\x82\xa4root\xd9,geometry_msgs/msg/AccelWithCovarianceStamped\xa5types\x86\xd9,geometry_msgs/msg/AccelWithCovarianceStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5accel\xa4type\xd9%geometry_msgs/msg/AccelWithCovariance\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9%geometry_msgs/msg/AccelWithCovariance\x82\xa6fields\x92\x82\xa4name\xa5accel\xa4type\xb7geometry_msgs/msg/Accel\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb7geometry_msgs/msg/Accel\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Inertia": (
        "RIHS01_2ddd5dab5c347825ba2e56c895ddccfd0b8efe53ae931bf67f905529930b4bd7",
        b"\x82\xa4root\xb9geometry_msgs/msg/Inertia\xa5types\x82\xb9geometry_msgs/msg/Inertia\x82\xa6fields\x98\x82\xa4name\xa1m\xa4type\xa7float64\x82\xa4name\xa3com\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa3ixx\xa4type\xa7float64\x82\xa4name\xa3ixy\xa4type\xa7float64\x82\xa4name\xa3ixz\xa4type\xa7float64\x82\xa4name\xa3iyy\xa4type\xa7float64\x82\xa4name\xa3iyz\xa4type\xa7float64\x82\xa4name\xa3izz\xa4type\xa7float64\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/InertiaStamped": (
        "RIHS01_766be45976252babf7f9d8ac4ae7c912a7ceccf71035622529f27518b695aa09",
        b"\x82\xa4root\xd9 geometry_msgs/msg/InertiaStamped\xa5types\x85\xd9 geometry_msgs/msg/InertiaStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa7inertia\xa4type\xb9geometry_msgs/msg/Inertia\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9geometry_msgs/msg/Inertia\x82\xa6fields\x98\x82\xa4name\xa1m\xa4type\xa7float64\x82\xa4name\xa3com\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa3ixx\xa4type\xa7float64\x82\xa4name\xa3ixy\xa4type\xa7float64\x82\xa4name\xa3ixz\xa4type\xa7float64\x82\xa4name\xa3iyy\xa4type\xa7float64\x82\xa4name\xa3iyz\xa4type\xa7float64\x82\xa4name\xa3izz\xa4type\xa7float64\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Point": (
        "RIHS01_6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881",
        b"\x82\xa4root\xb7geometry_msgs/msg/Point\xa5types\x81\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Point32": (
        "RIHS01_2fc4db7cae16a4582c79a56b66173a8d48d52c7dc520ddc55a0d4bcf2a4bfdbc",
        b"\x82\xa4root\xb9geometry_msgs/msg/Point32\xa5types\x81\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3",
    ),
    "geometry_msgs/msg/PointStamped": (
        "RIHS01_4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897",
        b"\x82\xa4root\xbegeometry_msgs/msg/PointStamped\xa5types\x84\xbegeometry_msgs/msg/PointStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5point\xa4type\xb7geometry_msgs/msg/Point\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Polygon": (
        "RIHS01_3782f9f0bf044964d692d6c017d705e37611afb1f0bf6a9dee248a7dda0f784a",
        b"\x82\xa4root\xb9geometry_msgs/msg/Polygon\xa5types\x82\xb9geometry_msgs/msg/Polygon\x82\xa6fields\x91\x82\xa4name\xa6points\xa4type\x92\xa4list\xb9geometry_msgs/msg/Point32\xa5array\xc3\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3",
    ),
    "geometry_msgs/msg/PolygonInstance": (
        "RIHS01_fa1cb3dc774329865258afef74f65b0553d487510c6d0f93ba38cc32d62ac0e5",
        b"\x82\xa4root\xd9!geometry_msgs/msg/PolygonInstance\xa5types\x83\xd9!geometry_msgs/msg/PolygonInstance\x82\xa6fields\x92\x82\xa4name\xa7polygon\xa4type\xb9geometry_msgs/msg/Polygon\x82\xa4name\xa2id\xa4type\xa5int64\xa5array\xc3\xb9geometry_msgs/msg/Polygon\x82\xa6fields\x91\x82\xa4name\xa6points\xa4type\x92\xa4list\xb9geometry_msgs/msg/Point32\xa5array\xc3\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3",
    ),
    "geometry_msgs/msg/PolygonInstanceStamped": (
        "RIHS01_802f37ea4398d7ce547936aab1fd278923716a13c63373887cd896957434ce2f",
        b"\x82\xa4root\xd9(geometry_msgs/msg/PolygonInstanceStamped\xa5types\x86\xd9(geometry_msgs/msg/PolygonInstanceStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa7polygon\xa4type\xd9!geometry_msgs/msg/PolygonInstance\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9!geometry_msgs/msg/PolygonInstance\x82\xa6fields\x92\x82\xa4name\xa7polygon\xa4type\xb9geometry_msgs/msg/Polygon\x82\xa4name\xa2id\xa4type\xa5int64\xa5array\xc3\xb9geometry_msgs/msg/Polygon\x82\xa6fields\x91\x82\xa4name\xa6points\xa4type\x92\xa4list\xb9geometry_msgs/msg/Point32\xa5array\xc3\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3",
    ),
    "geometry_msgs/msg/PolygonStamped": (
        "RIHS01_b7cf07932f1523d4b4088075945c1a0141f7cd21da87cc940fc61652e9138b46",
        b"\x82\xa4root\xd9 geometry_msgs/msg/PolygonStamped\xa5types\x85\xd9 geometry_msgs/msg/PolygonStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa7polygon\xa4type\xb9geometry_msgs/msg/Polygon\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9geometry_msgs/msg/Polygon\x82\xa6fields\x91\x82\xa4name\xa6points\xa4type\x92\xa4list\xb9geometry_msgs/msg/Point32\xa5array\xc3\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3",
    ),
    "geometry_msgs/msg/Pose": (
        "RIHS01_d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa",
        b"\x82\xa4root\xb6geometry_msgs/msg/Pose\xa5types\x83\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/Pose2D": (
        "RIHS01_d68efa5b46e70f7b16ca23085474fdac5a44b638783ec42f661da64da4724ccc",
        b"\x82\xa4root\xb8geometry_msgs/msg/Pose2D\xa5types\x81\xb8geometry_msgs/msg/Pose2D\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa5theta\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/PoseArray": (
        "RIHS01_af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0",
        b"\x82\xa4root\xbbgeometry_msgs/msg/PoseArray\xa5types\x86\xbbgeometry_msgs/msg/PoseArray\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5poses\xa4type\x92\xa4list\xb6geometry_msgs/msg/Pose\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/PoseStamped": (
        "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
        b"\x82\xa4root\xbdgeometry_msgs/msg/PoseStamped\xa5types\x86\xbdgeometry_msgs/msg/PoseStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/PoseWithCovariance": (
        "RIHS01_9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb",
        b"\x82\xa4root\xd9$geometry_msgs/msg/PoseWithCovariance\xa5types\x84\xd9$geometry_msgs/msg/PoseWithCovariance\x82\xa6fields\x92\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
        b"\x82\xa4root\xd9+geometry_msgs/msg/PoseWithCovarianceStamped\xa5types\x87\xd9+geometry_msgs/msg/PoseWithCovarianceStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4pose\xa4type\xd9$geometry_msgs/msg/PoseWithCovariance\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9$geometry_msgs/msg/PoseWithCovariance\x82\xa6fields\x92\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/Quaternion": (
        "RIHS01_8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684",
        b"\x82\xa4root\xbcgeometry_msgs/msg/Quaternion\xa5types\x81\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/QuaternionStamped": (
        "RIHS01_381add86c6c3160644d228ca342182c7fd6c7fab11c7a85ad817a9cc22dbac6e",
        b"\x82\xa4root\xd9#geometry_msgs/msg/QuaternionStamped\xa5types\x84\xd9#geometry_msgs/msg/QuaternionStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaaquaternion\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/Transform": (
        "RIHS01_beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc",
        b"\x82\xa4root\xbbgeometry_msgs/msg/Transform\xa5types\x83\xbbgeometry_msgs/msg/Transform\x82\xa6fields\x92\x82\xa4name\xabtranslation\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa8rotation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "geometry_msgs/msg/TransformStamped": (
        "RIHS01_0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
        b'\x82\xa4root\xd9"geometry_msgs/msg/TransformStamped\xa5types\x86\xd9"geometry_msgs/msg/TransformStamped\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaechild_frame_id\xa4type\xa6string\x82\xa4name\xa9transform\xa4type\xbbgeometry_msgs/msg/Transform\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbbgeometry_msgs/msg/Transform\x82\xa6fields\x92\x82\xa4name\xabtranslation\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa8rotation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3',
    ),
    "geometry_msgs/msg/Twist": (
        "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
        b"\x82\xa4root\xb7geometry_msgs/msg/Twist\xa5types\x82\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/TwistStamped": (
        "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
        b"\x82\xa4root\xbegeometry_msgs/msg/TwistStamped\xa5types\x85\xbegeometry_msgs/msg/TwistStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5twist\xa4type\xb7geometry_msgs/msg/Twist\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/TwistWithCovariance": (
        "RIHS01_49f574f033f095d8b6cd1beaca5ca7925e296e84af1716d16c89d38b059c8c18",
        b"\x82\xa4root\xd9%geometry_msgs/msg/TwistWithCovariance\xa5types\x83\xd9%geometry_msgs/msg/TwistWithCovariance\x82\xa6fields\x92\x82\xa4name\xa5twist\xa4type\xb7geometry_msgs/msg/Twist\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (
        "RIHS01_77b67434531e6529b7a0091357b186b6ebdb17fd9ffd3e0c7ce9d3fb11a44563",
        b"\x82\xa4root\xd9,geometry_msgs/msg/TwistWithCovarianceStamped\xa5types\x86\xd9,geometry_msgs/msg/TwistWithCovarianceStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5twist\xa4type\xd9%geometry_msgs/msg/TwistWithCovariance\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9%geometry_msgs/msg/TwistWithCovariance\x82\xa6fields\x92\x82\xa4name\xa5twist\xa4type\xb7geometry_msgs/msg/Twist\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Vector3": (
        "RIHS01_cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d",
        b"\x82\xa4root\xb9geometry_msgs/msg/Vector3\xa5types\x81\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Vector3Stamped": (
        "RIHS01_d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a",
        b"\x82\xa4root\xd9 geometry_msgs/msg/Vector3Stamped\xa5types\x84\xd9 geometry_msgs/msg/Vector3Stamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6vector\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/VelocityStamped": (
        "RIHS01_55e7196186c8dbe4375278d7f1ac050dd8c9bacade1cf3eef8460fa667bd2457",
        b"\x82\xa4root\xd9!geometry_msgs/msg/VelocityStamped\xa5types\x85\xd9!geometry_msgs/msg/VelocityStamped\x82\xa6fields\x94\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xadbody_frame_id\xa4type\xa6string\x82\xa4name\xb2reference_frame_id\xa4type\xa6string\x82\xa4name\xa8velocity\xa4type\xb7geometry_msgs/msg/Twist\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/Wrench": (
        "RIHS01_018e8519d57c16adbe97c9fe1460ef21fec7e31bc541de3d653a35895677ce52",
        b"\x82\xa4root\xb8geometry_msgs/msg/Wrench\xa5types\x82\xb8geometry_msgs/msg/Wrench\x82\xa6fields\x92\x82\xa4name\xa5force\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa6torque\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "geometry_msgs/msg/WrenchStamped": (
        "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
        b"\x82\xa4root\xbfgeometry_msgs/msg/WrenchStamped\xa5types\x85\xbfgeometry_msgs/msg/WrenchStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6wrench\xa4type\xb8geometry_msgs/msg/Wrench\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb8geometry_msgs/msg/Wrench\x82\xa6fields\x92\x82\xa4name\xa5force\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa6torque\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "nav_msgs/msg/Goals": (
        "RIHS01_02305a51633b5c04d8979b878a7577cafd422f8a07465c878b17a920af3759e9",
        b"\x82\xa4root\xb2nav_msgs/msg/Goals\xa5types\x87\xb2nav_msgs/msg/Goals\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5goals\xa4type\x92\xa4list\xbdgeometry_msgs/msg/PoseStamped\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbdgeometry_msgs/msg/PoseStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "nav_msgs/msg/GridCells": (
        "RIHS01_bb99c2f5d0a04750745a81ec6a8147aa373cce5bd17c8cd6507f2413354a6933",
        b"\x82\xa4root\xb6nav_msgs/msg/GridCells\xa5types\x84\xb6nav_msgs/msg/GridCells\x82\xa6fields\x94\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaacell_width\xa4type\xa7float32\x82\xa4name\xabcell_height\xa4type\xa7float32\x82\xa4name\xa5cells\xa4type\x92\xa4list\xb7geometry_msgs/msg/Point\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "nav_msgs/msg/MapMetaData": (
        "RIHS01_2772d4b2000ef2b35dbaeb80fd3946c1369f817fb4f75677d916d27c17d763c8",
        b"\x82\xa4root\xb8nav_msgs/msg/MapMetaData\xa5types\x85\xb8nav_msgs/msg/MapMetaData\x82\xa6fields\x95\x82\xa4name\xadmap_load_time\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xaaresolution\xa4type\xa7float32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa6origin\xa4type\xb6geometry_msgs/msg/Pose\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "nav_msgs/msg/OccupancyGrid": (
        "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
        b"\x82\xa4root\xbanav_msgs/msg/OccupancyGrid\xa5types\x87\xbanav_msgs/msg/OccupancyGrid\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4info\xa4type\xb8nav_msgs/msg/MapMetaData\x82\xa4name\xa4data\xa4type\x92\xa4list\xa4int8\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb8nav_msgs/msg/MapMetaData\x82\xa6fields\x95\x82\xa4name\xadmap_load_time\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xaaresolution\xa4type\xa7float32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa6origin\xa4type\xb6geometry_msgs/msg/Pose\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "nav_msgs/msg/Odometry": (
        "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
        b"\x82\xa4root\xb5nav_msgs/msg/Odometry\xa5types\x8a\xb5nav_msgs/msg/Odometry\x82\xa6fields\x94\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaechild_frame_id\xa4type\xa6string\x82\xa4name\xa4pose\xa4type\xd9$geometry_msgs/msg/PoseWithCovariance\x82\xa4name\xa5twist\xa4type\xd9%geometry_msgs/msg/TwistWithCovariance\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9$geometry_msgs/msg/PoseWithCovariance\x82\xa6fields\x92\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3\xd9%geometry_msgs/msg/TwistWithCovariance\x82\xa6fields\x92\x82\xa4name\xa5twist\xa4type\xb7geometry_msgs/msg/Twist\x82\xa4name\xaacovariance\xa4type\x94\xa4list\xa7float64$$\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "nav_msgs/msg/Path": (
        "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
        b"\x82\xa4root\xb1nav_msgs/msg/Path\xa5types\x87\xb1nav_msgs/msg/Path\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa5poses\xa4type\x92\xa4list\xbdgeometry_msgs/msg/PoseStamped\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbdgeometry_msgs/msg/PoseStamped\x82\xa6fields\x92\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4pose\xa4type\xb6geometry_msgs/msg/Pose\xa5array\xc3\xb6geometry_msgs/msg/Pose\x82\xa6fields\x92\x82\xa4name\xa8position\xa4type\xb7geometry_msgs/msg/Point\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb7geometry_msgs/msg/Point\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3",
    ),
    "rcl_interfaces/msg/Log": (
        "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
        b"\x82\xa4root\xb6rcl_interfaces/msg/Log\xa5types\x82\xb6rcl_interfaces/msg/Log\x82\xa6fields\x97\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa5level\xa4type\xa5uint8\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa3msg\xa4type\xa6string\x82\xa4name\xa4file\xa4type\xa6string\x82\xa4name\xa8function\xa4type\xa6string\x82\xa4name\xa4line\xa4type\xa6uint32\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/BatteryState": (
        "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
        b"\x82\xa4root\xbcsensor_msgs/msg/BatteryState\xa5types\x83\xbcsensor_msgs/msg/BatteryState\x82\xa6fields\xdc\x00\x10\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa7voltage\xa4type\xa7float32\x82\xa4name\xabtemperature\xa4type\xa7float32\x82\xa4name\xa7current\xa4type\xa7float32\x82\xa4name\xa6charge\xa4type\xa7float32\x82\xa4name\xa8capacity\xa4type\xa7float32\x82\xa4name\xafdesign_capacity\xa4type\xa7float32\x82\xa4name\xaapercentage\xa4type\xa7float32\x82\xa4name\xb3power_supply_status\xa4type\xa5uint8\x82\xa4name\xb3power_supply_health\xa4type\xa5uint8\x82\xa4name\xb7power_supply_technology\xa4type\xa5uint8\x82\xa4name\xa7present\xa4type\xa4bool\x82\xa4name\xaccell_voltage\xa4type\x92\xa4list\xa7float32\x82\xa4name\xb0cell_temperature\xa4type\x92\xa4list\xa7float32\x82\xa4name\xa8location\xa4type\xa6string\x82\xa4name\xadserial_number\xa4type\xa6string\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/CameraInfo": (
        "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
        b"\x82\xa4root\xbasensor_msgs/msg/CameraInfo\xa5types\x84\xbasensor_msgs/msg/CameraInfo\x82\xa6fields\x9b\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xb0distortion_model\xa4type\xa6string\x82\xa4name\xa1d\xa4type\x92\xa4list\xa7float64\x82\xa4name\xa1k\xa4type\x94\xa4list\xa7float64\t\t\x82\xa4name\xa1r\xa4type\x94\xa4list\xa7float64\t\t\x82\xa4name\xa1p\xa4type\x94\xa4list\xa7float64\x0c\x0c\x82\xa4name\xa9binning_x\xa4type\xa6uint32\x82\xa4name\xa9binning_y\xa4type\xa6uint32\x82\xa4name\xa3roi\xa4type\xd9 sensor_msgs/msg/RegionOfInterest\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xd9 sensor_msgs/msg/RegionOfInterest\x82\xa6fields\x95\x82\xa4name\xa8x_offset\xa4type\xa6uint32\x82\xa4name\xa8y_offset\xa4type\xa6uint32\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xaado_rectify\xa4type\xa4bool\xa5array\xc3",
    ),
    "sensor_msgs/msg/ChannelFloat32": (
        "RIHS01_92665437ddf39346f4ba39ee32e648390605b633cc077d40f4bd4d7b58af6cd4",
        b"\x82\xa4root\xbesensor_msgs/msg/ChannelFloat32\xa5types\x81\xbesensor_msgs/msg/ChannelFloat32\x82\xa6fields\x92\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa6values\xa4type\x92\xa4list\xa7float32\xa5array\xc3",
    ),
    "sensor_msgs/msg/CompressedImage": (
        "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
        b"\x82\xa4root\xbfsensor_msgs/msg/CompressedImage\xa5types\x83\xbfsensor_msgs/msg/CompressedImage\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6format\xa4type\xa6string\x82\xa4name\xa4data\xa4type\xa7uint8[]\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/FluidPressure": (
        "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
        b"\x82\xa4root\xbdsensor_msgs/msg/FluidPressure\xa5types\x83\xbdsensor_msgs/msg/FluidPressure\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaefluid_pressure\xa4type\xa7float64\x82\xa4name\xa8variance\xa4type\xa7float64\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Illuminance": (
        "RIHS01_b954b25f452fcf81a91c9c2a7e3b3fd85c4c873d452aecb3cfd8fd1da732a22d",
        b"\x82\xa4root\xbbsensor_msgs/msg/Illuminance\xa5types\x83\xbbsensor_msgs/msg/Illuminance\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xabilluminance\xa4type\xa7float64\x82\xa4name\xa8variance\xa4type\xa7float64\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Image": (
        "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
        b"\x82\xa4root\xb5sensor_msgs/msg/Image\xa5types\x83\xb5sensor_msgs/msg/Image\x82\xa6fields\x97\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xa8encoding\xa4type\xa6string\x82\xa4name\xacis_bigendian\xa4type\xa5uint8\x82\xa4name\xa4step\xa4type\xa6uint32\x82\xa4name\xa4data\xa4type\xa7uint8[]\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Imu": (
        "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
        b"\x82\xa4root\xb3sensor_msgs/msg/Imu\xa5types\x85\xb3sensor_msgs/msg/Imu\x82\xa6fields\x97\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaborientation\xa4type\xbcgeometry_msgs/msg/Quaternion\x82\xa4name\xb6orientation_covariance\xa4type\x94\xa4list\xa7float64\t\t\x82\xa4name\xb0angular_velocity\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xbbangular_velocity_covariance\xa4type\x94\xa4list\xa7float64\t\t\x82\xa4name\xb3linear_acceleration\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xbelinear_acceleration_covariance\xa4type\x94\xa4list\xa7float64\t\t\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "sensor_msgs/msg/JointState": (
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
        b"\x82\xa4root\xbasensor_msgs/msg/JointState\xa5types\x83\xbasensor_msgs/msg/JointState\x82\xa6fields\x95\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4name\xa4type\x92\xa4list\xa6string\x82\xa4name\xa8position\xa4type\x92\xa4list\xa7float64\x82\xa4name\xa8velocity\xa4type\x92\xa4list\xa7float64\x82\xa4name\xa6effort\xa4type\x92\xa4list\xa7float64\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Joy": (
        "RIHS01_0d356c79cad3401e35ffeb75a96a96e08be3ef896b8b83841d73e890989372c5",
        b"\x82\xa4root\xb3sensor_msgs/msg/Joy\xa5types\x83\xb3sensor_msgs/msg/Joy\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa4axes\xa4type\x92\xa4list\xa7float32\x82\xa4name\xa7buttons\xa4type\x92\xa4list\xa5int32\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/JoyFeedback": (
        "RIHS01_231dd362f71d6fc08272770d07120ad5fe5874ce2dbac70109b28986834290cd",
        b"\x82\xa4root\xbbsensor_msgs/msg/JoyFeedback\xa5types\x81\xbbsensor_msgs/msg/JoyFeedback\x82\xa6fields\x93\x82\xa4name\xa4type\xa4type\xa5uint8\x82\xa4name\xa2id\xa4type\xa5uint8\x82\xa4name\xa9intensity\xa4type\xa7float32\xa5array\xc3",
    ),
    "sensor_msgs/msg/JoyFeedbackArray": (
        "RIHS01_3287c32e1b688cae04555e465443df3cca7dae76ee4ebf85c4658d585037bcaa",
        b"\x82\xa4root\xd9 sensor_msgs/msg/JoyFeedbackArray\xa5types\x82\xd9 sensor_msgs/msg/JoyFeedbackArray\x82\xa6fields\x91\x82\xa4name\xa5array\xa4type\x92\xa4list\xbbsensor_msgs/msg/JoyFeedback\xa5array\xc3\xbbsensor_msgs/msg/JoyFeedback\x82\xa6fields\x93\x82\xa4name\xa4type\xa4type\xa5uint8\x82\xa4name\xa2id\xa4type\xa5uint8\x82\xa4name\xa9intensity\xa4type\xa7float32\xa5array\xc3",
    ),
    "sensor_msgs/msg/LaserEcho": (
        "RIHS01_0fbc05a0db7d37fe52c0f0375356db55da0046f7ef5bd27ca6b34bd0582bc952",
        b"\x82\xa4root\xb9sensor_msgs/msg/LaserEcho\xa5types\x81\xb9sensor_msgs/msg/LaserEcho\x82\xa6fields\x91\x82\xa4name\xa6echoes\xa4type\x92\xa4list\xa7float32\xa5array\xc3",
    ),
    "sensor_msgs/msg/LaserScan": (
        "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
        b"\x82\xa4root\xb9sensor_msgs/msg/LaserScan\xa5types\x83\xb9sensor_msgs/msg/LaserScan\x82\xa6fields\x9a\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa9angle_min\xa4type\xa7float32\x82\xa4name\xa9angle_max\xa4type\xa7float32\x82\xa4name\xafangle_increment\xa4type\xa7float32\x82\xa4name\xaetime_increment\xa4type\xa7float32\x82\xa4name\xa9scan_time\xa4type\xa7float32\x82\xa4name\xa9range_min\xa4type\xa7float32\x82\xa4name\xa9range_max\xa4type\xa7float32\x82\xa4name\xa6ranges\xa4type\x92\xa4list\xa7float32\x82\xa4name\xabintensities\xa4type\x92\xa4list\xa7float32\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/MagneticField": (
        "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
        b"\x82\xa4root\xbdsensor_msgs/msg/MagneticField\xa5types\x84\xbdsensor_msgs/msg/MagneticField\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaemagnetic_field\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xb9magnetic_field_covariance\xa4type\x94\xa4list\xa7float64\t\t\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3",
    ),
    "sensor_msgs/msg/MultiDOFJointState": (
        "RIHS01_4d4ded702cfba7ff3ec783835c1a1425f75e53939a430ff355d1fee4b3bbc40b",
        b'\x82\xa4root\xd9"sensor_msgs/msg/MultiDOFJointState\xa5types\x88\xd9"sensor_msgs/msg/MultiDOFJointState\x82\xa6fields\x95\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xabjoint_names\xa4type\x92\xa4list\xa6string\x82\xa4name\xaatransforms\xa4type\x92\xa4list\xbbgeometry_msgs/msg/Transform\x82\xa4name\xa5twist\xa4type\x92\xa4list\xb7geometry_msgs/msg/Twist\x82\xa4name\xa6wrench\xa4type\x92\xa4list\xb8geometry_msgs/msg/Wrench\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbbgeometry_msgs/msg/Transform\x82\xa6fields\x92\x82\xa4name\xabtranslation\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa8rotation\xa4type\xbcgeometry_msgs/msg/Quaternion\xa5array\xc3\xb9geometry_msgs/msg/Vector3\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\xa5array\xc3\xbcgeometry_msgs/msg/Quaternion\x82\xa6fields\x94\x82\xa4name\xa1x\xa4type\xa7float64\x82\xa4name\xa1y\xa4type\xa7float64\x82\xa4name\xa1z\xa4type\xa7float64\x83\xa4name\xa1w\xa4type\xa7float64\xa7default\xcb?\xf0\x00\x00\x00\x00\x00\x00\xa5array\xc3\xb7geometry_msgs/msg/Twist\x82\xa6fields\x92\x82\xa4name\xa6linear\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa7angular\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3\xb8geometry_msgs/msg/Wrench\x82\xa6fields\x92\x82\xa4name\xa5force\xa4type\xb9geometry_msgs/msg/Vector3\x82\xa4name\xa6torque\xa4type\xb9geometry_msgs/msg/Vector3\xa5array\xc3',
    ),
    "sensor_msgs/msg/MultiEchoLaserScan": (
        "RIHS01_ba5eac341cd5bbb2701527aa4568e8baec172b69cadb9a1945d6f149d087ee48",
        b'\x82\xa4root\xd9"sensor_msgs/msg/MultiEchoLaserScan\xa5types\x84\xd9"sensor_msgs/msg/MultiEchoLaserScan\x82\xa6fields\x9a\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa9angle_min\xa4type\xa7float32\x82\xa4name\xa9angle_max\xa4type\xa7float32\x82\xa4name\xafangle_increment\xa4type\xa7float32\x82\xa4name\xaetime_increment\xa4type\xa7float32\x82\xa4name\xa9scan_time\xa4type\xa7float32\x82\xa4name\xa9range_min\xa4type\xa7float32\x82\xa4name\xa9range_max\xa4type\xa7float32\x82\xa4name\xa6ranges\xa4type\x92\xa4list\xb9sensor_msgs/msg/LaserEcho\x82\xa4name\xabintensities\xa4type\x92\xa4list\xb9sensor_msgs/msg/LaserEcho\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9sensor_msgs/msg/LaserEcho\x82\xa6fields\x91\x82\xa4name\xa6echoes\xa4type\x92\xa4list\xa7float32\xa5array\xc3',
    ),
    "sensor_msgs/msg/NavSatFix": (
        "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
        b"\x82\xa4root\xb9sensor_msgs/msg/NavSatFix\xa5types\x84\xb9sensor_msgs/msg/NavSatFix\x82\xa6fields\x97\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6status\xa4type\xbcsensor_msgs/msg/NavSatStatus\x82\xa4name\xa8latitude\xa4type\xa7float64\x82\xa4name\xa9longitude\xa4type\xa7float64\x82\xa4name\xa8altitude\xa4type\xa7float64\x82\xa4name\xb3position_covariance\xa4type\x94\xa4list\xa7float64\t\t\x82\xa4name\xb8position_covariance_type\xa4type\xa5uint8\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbcsensor_msgs/msg/NavSatStatus\x82\xa6fields\x92\x83\xa4name\xa6status\xa4type\xa4int8\xa7default\xfe\x82\xa4name\xa7service\xa4type\xa6uint16\xa5array\xc3",
    ),
    "sensor_msgs/msg/NavSatStatus": (
        "RIHS01_d1ed3befa628e09571bd273b888ba1c1fd187c9a5e0006b385d7e5e9095a3204",
        b"\x82\xa4root\xbcsensor_msgs/msg/NavSatStatus\xa5types\x81\xbcsensor_msgs/msg/NavSatStatus\x82\xa6fields\x92\x83\xa4name\xa6status\xa4type\xa4int8\xa7default\xfe\x82\xa4name\xa7service\xa4type\xa6uint16\xa5array\xc3",
    ),
    "sensor_msgs/msg/PointCloud": (
        "RIHS01_614593df71d3c2b9bd4604a71b750fd218f0d65c045ea988b713719455a65b3b",
        b"\x82\xa4root\xbasensor_msgs/msg/PointCloud\xa5types\x85\xbasensor_msgs/msg/PointCloud\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6points\xa4type\x92\xa4list\xb9geometry_msgs/msg/Point32\x82\xa4name\xa8channels\xa4type\x92\xa4list\xbesensor_msgs/msg/ChannelFloat32\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xb9geometry_msgs/msg/Point32\x82\xa6fields\x93\x82\xa4name\xa1x\xa4type\xa7float32\x82\xa4name\xa1y\xa4type\xa7float32\x82\xa4name\xa1z\xa4type\xa7float32\xa5array\xc3\xbesensor_msgs/msg/ChannelFloat32\x82\xa6fields\x92\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa6values\xa4type\x92\xa4list\xa7float32\xa5array\xc3",
    ),
    "sensor_msgs/msg/PointCloud2": (
        "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
        b"\x82\xa4root\xbbsensor_msgs/msg/PointCloud2\xa5types\x84\xbbsensor_msgs/msg/PointCloud2\x82\xa6fields\x99\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xa6fields\xa4type\x92\xa4list\xbasensor_msgs/msg/PointField\x82\xa4name\xacis_bigendian\xa4type\xa4bool\x82\xa4name\xaapoint_step\xa4type\xa6uint32\x82\xa4name\xa8row_step\xa4type\xa6uint32\x82\xa4name\xa4data\xa4type\xa7uint8[]\x82\xa4name\xa8is_dense\xa4type\xa4bool\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbasensor_msgs/msg/PointField\x82\xa6fields\x94\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa6offset\xa4type\xa6uint32\x82\xa4name\xa8datatype\xa4type\xa5uint8\x82\xa4name\xa5count\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/PointField": (
        "RIHS01_5c6a4750728c2bcfbbf7037225b20b02d4429634732146b742dee1726637ef01",
        b"\x82\xa4root\xbasensor_msgs/msg/PointField\xa5types\x81\xbasensor_msgs/msg/PointField\x82\xa6fields\x94\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa6offset\xa4type\xa6uint32\x82\xa4name\xa8datatype\xa4type\xa5uint8\x82\xa4name\xa5count\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Range": (
        "RIHS01_b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
        b"\x82\xa4root\xb5sensor_msgs/msg/Range\xa5types\x83\xb5sensor_msgs/msg/Range\x82\xa6fields\x97\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xaeradiation_type\xa4type\xa5uint8\x82\xa4name\xadfield_of_view\xa4type\xa7float32\x82\xa4name\xa9min_range\xa4type\xa7float32\x82\xa4name\xa9max_range\xa4type\xa7float32\x82\xa4name\xa5range\xa4type\xa7float32\x82\xa4name\xa8variance\xa4type\xa7float32\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/RegionOfInterest": (
        "RIHS01_ad16bcba5f9131dcdba6fbded19f726f5440e3c513b4fb586dd3027eeed8abb1",
        b"\x82\xa4root\xd9 sensor_msgs/msg/RegionOfInterest\xa5types\x81\xd9 sensor_msgs/msg/RegionOfInterest\x82\xa6fields\x95\x82\xa4name\xa8x_offset\xa4type\xa6uint32\x82\xa4name\xa8y_offset\xa4type\xa6uint32\x82\xa4name\xa6height\xa4type\xa6uint32\x82\xa4name\xa5width\xa4type\xa6uint32\x82\xa4name\xaado_rectify\xa4type\xa4bool\xa5array\xc3",
    ),
    "sensor_msgs/msg/RelativeHumidity": (
        "RIHS01_8687c99b4fb393cb2e545e407b5ea7fd0b5d8960bcd849a0f86c544740138839",
        b"\x82\xa4root\xd9 sensor_msgs/msg/RelativeHumidity\xa5types\x83\xd9 sensor_msgs/msg/RelativeHumidity\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xb1relative_humidity\xa4type\xa7float64\x82\xa4name\xa8variance\xa4type\xa7float64\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/Temperature": (
        "RIHS01_72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8",
        b"\x82\xa4root\xbbsensor_msgs/msg/Temperature\xa5types\x83\xbbsensor_msgs/msg/Temperature\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xabtemperature\xa4type\xa7float64\x82\xa4name\xa8variance\xa4type\xa7float64\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "sensor_msgs/msg/TimeReference": (
        "RIHS01_dd66e84cf40bbb5d5a40472e6ecf2675a031334d4c426abdb2ad41801a8efc99",
        b"\x82\xa4root\xbdsensor_msgs/msg/TimeReference\xa5types\x83\xbdsensor_msgs/msg/TimeReference\x82\xa6fields\x93\x82\xa4name\xa6header\xa4type\xb3std_msgs/msg/Header\x82\xa4name\xa8time_ref\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa6source\xa4type\xa6string\xa5array\xc3\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Bool": (
        "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
        b"\x82\xa4root\xb1std_msgs/msg/Bool\xa5types\x81\xb1std_msgs/msg/Bool\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa4bool\xa5array\xc3",
    ),
    "std_msgs/msg/Byte": (
        "RIHS01_41e1a3345f73fe93ede006da826a6ee274af23dd4653976ff249b0f44e3e798f",
        b"\x82\xa4root\xb1std_msgs/msg/Byte\xa5types\x81\xb1std_msgs/msg/Byte\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa4byte\xa5array\xc3",
    ),
    "std_msgs/msg/ByteMultiArray": (
        "RIHS01_972fec7f50ab3c1d06783c228e79e8a9a509021708c511c059926261ada901d4",
        b"\x82\xa4root\xbbstd_msgs/msg/ByteMultiArray\xa5types\x83\xbbstd_msgs/msg/ByteMultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\xa6byte[]\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Char": (
        "RIHS01_3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9",
        b"\x82\xa4root\xb1std_msgs/msg/Char\xa5types\x81\xb1std_msgs/msg/Char\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa4char\xa5array\xc3",
    ),
    "std_msgs/msg/ColorRGBA": (
        "RIHS01_77a7a5b9ae477306097665106e0413ba74440245b1f3d0c6d6405fe5c7813fe8",
        b"\x82\xa4root\xb6std_msgs/msg/ColorRGBA\xa5types\x81\xb6std_msgs/msg/ColorRGBA\x82\xa6fields\x94\x82\xa4name\xa1r\xa4type\xa7float32\x82\xa4name\xa1g\xa4type\xa7float32\x82\xa4name\xa1b\xa4type\xa7float32\x82\xa4name\xa1a\xa4type\xa7float32\xa5array\xc3",
    ),
    "std_msgs/msg/Empty": (
        "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
        b"\x82\xa4root\xb2std_msgs/msg/Empty\xa5types\x81\xb2std_msgs/msg/Empty\x82\xa6fields\x90\xa5array\xc3",
    ),
    "std_msgs/msg/Float32": (
        "RIHS01_7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2",
        b"\x82\xa4root\xb4std_msgs/msg/Float32\xa5types\x81\xb4std_msgs/msg/Float32\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa7float32\xa5array\xc3",
    ),
    "std_msgs/msg/Float32MultiArray": (
        "RIHS01_0599f6f85b4bfca379873a0b4375a0aca022156bd2d7021275d116ed1fa8bfe0",
        b"\x82\xa4root\xbestd_msgs/msg/Float32MultiArray\xa5types\x83\xbestd_msgs/msg/Float32MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa7float32\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Float64": (
        "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
        b"\x82\xa4root\xb4std_msgs/msg/Float64\xa5types\x81\xb4std_msgs/msg/Float64\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa7float64\xa5array\xc3",
    ),
    "std_msgs/msg/Float64MultiArray": (
        "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
        b"\x82\xa4root\xbestd_msgs/msg/Float64MultiArray\xa5types\x83\xbestd_msgs/msg/Float64MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa7float64\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Header": (
        "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
        b"\x82\xa4root\xb3std_msgs/msg/Header\xa5types\x82\xb3std_msgs/msg/Header\x82\xa6fields\x92\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa8frame_id\xa4type\xa6string\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Int8": (
        "RIHS01_26525065a403d972cb672f0777e333f0c799ad444ae5fcd79e43d1e73bd0f440",
        b"\x82\xa4root\xb1std_msgs/msg/Int8\xa5types\x81\xb1std_msgs/msg/Int8\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa4int8\xa5array\xc3",
    ),
    "std_msgs/msg/Int8MultiArray": (
        "RIHS01_f21998d4b492abd63330765d75d5831238d400740386f651f13a872a4d2188db",
        b"\x82\xa4root\xbbstd_msgs/msg/Int8MultiArray\xa5types\x83\xbbstd_msgs/msg/Int8MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa4int8\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Int16": (
        "RIHS01_1dcc3464e47c288a55f943a389d337cdb06804de3f5cd7a266b0de718eee17e5",
        b"\x82\xa4root\xb2std_msgs/msg/Int16\xa5types\x81\xb2std_msgs/msg/Int16\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa5int16\xa5array\xc3",
    ),
    "std_msgs/msg/Int16MultiArray": (
        "RIHS01_b58810e8e5b90fb19a5062469eb8409f5ab11a446d60de7157a1457e52a076ce",
        b"\x82\xa4root\xbcstd_msgs/msg/Int16MultiArray\xa5types\x83\xbcstd_msgs/msg/Int16MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa5int16\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Int32": (
        "RIHS01_b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb",
        b"\x82\xa4root\xb2std_msgs/msg/Int32\xa5types\x81\xb2std_msgs/msg/Int32\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa5int32\xa5array\xc3",
    ),
    "std_msgs/msg/Int32MultiArray": (
        "RIHS01_84a7346323525d1b4dfca899df3820f245e54009dac5a6b69217d14fdefd1701",
        b"\x82\xa4root\xbcstd_msgs/msg/Int32MultiArray\xa5types\x83\xbcstd_msgs/msg/Int32MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa5int32\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/Int64": (
        "RIHS01_8cd1048c2f186b6bd9a92472dc1ce51723c0833a221e2b7aecfff111774f4b49",
        b"\x82\xa4root\xb2std_msgs/msg/Int64\xa5types\x81\xb2std_msgs/msg/Int64\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa5int64\xa5array\xc3",
    ),
    "std_msgs/msg/Int64MultiArray": (
        "RIHS01_e60f9fe34d697f0939ad49d33158693c1277fbac0e2f04b7c2995dc21c89b422",
        b"\x82\xa4root\xbcstd_msgs/msg/Int64MultiArray\xa5types\x83\xbcstd_msgs/msg/Int64MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa5int64\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/MultiArrayDimension": (
        "RIHS01_5e773a60a4c7fc8a54985f307c7837aa2994252a126c301957a24e31282c9cbe",
        b"\x82\xa4root\xd9 std_msgs/msg/MultiArrayDimension\xa5types\x81\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/MultiArrayLayout": (
        "RIHS01_4c66e6f78e740ac103a94cf63259f968e48c617e7699e829b63c21a5cb50dac6",
        b"\x82\xa4root\xbdstd_msgs/msg/MultiArrayLayout\xa5types\x82\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/String": (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        b"\x82\xa4root\xb3std_msgs/msg/String\xa5types\x81\xb3std_msgs/msg/String\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa6string\xa5array\xc3",
    ),
    "std_msgs/msg/UInt8": (
        "RIHS01_6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010",
        b"\x82\xa4root\xb2std_msgs/msg/UInt8\xa5types\x81\xb2std_msgs/msg/UInt8\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa5uint8\xa5array\xc3",
    ),
    "std_msgs/msg/UInt8MultiArray": (
        "RIHS01_5687e861b8d307a5e48b7515467ae7a5fc2daf805bd0ce6d8e9e604bade9f385",
        b"\x82\xa4root\xbcstd_msgs/msg/UInt8MultiArray\xa5types\x83\xbcstd_msgs/msg/UInt8MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\xa7uint8[]\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/UInt16": (
        "RIHS01_08a406e4b022bc22e907f985d6a9e9dd1d4fbecae573549cf49350113e7757b1",
        b"\x82\xa4root\xb3std_msgs/msg/UInt16\xa5types\x81\xb3std_msgs/msg/UInt16\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa6uint16\xa5array\xc3",
    ),
    "std_msgs/msg/UInt16MultiArray": (
        "RIHS01_94fe73428ec63baecc774f8fb82406123e9291cf728f1b7c91caf5335129492b",
        b"\x82\xa4root\xbdstd_msgs/msg/UInt16MultiArray\xa5types\x83\xbdstd_msgs/msg/UInt16MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa6uint16\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/UInt32": (
        "RIHS01_a5c874829b752bc5fa190024b0ad76f578cc278271e855c7d02a818b3516fb4a",
        b"\x82\xa4root\xb3std_msgs/msg/UInt32\xa5types\x81\xb3std_msgs/msg/UInt32\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/UInt32MultiArray": (
        "RIHS01_6c2577c7ad3cbdcc2164a41c12f1d5ad314ea320f3fb1ee47e78019fe16bb5b0",
        b"\x82\xa4root\xbdstd_msgs/msg/UInt32MultiArray\xa5types\x83\xbdstd_msgs/msg/UInt32MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa6uint32\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "std_msgs/msg/UInt64": (
        "RIHS01_fbdc52018fc13755dce18024d1a671c856aa8b4aaf63adfb095b608f98e8c943",
        b"\x82\xa4root\xb3std_msgs/msg/UInt64\xa5types\x81\xb3std_msgs/msg/UInt64\x82\xa6fields\x91\x82\xa4name\xa4data\xa4type\xa6uint64\xa5array\xc3",
    ),
    "std_msgs/msg/UInt64MultiArray": (
        "RIHS01_fc1c685c2f76bdc6983da025cb25d2db5fb5157b059e300f6d957d86f981b366",
        b"\x82\xa4root\xbdstd_msgs/msg/UInt64MultiArray\xa5types\x83\xbdstd_msgs/msg/UInt64MultiArray\x82\xa6fields\x92\x82\xa4name\xa6layout\xa4type\xbdstd_msgs/msg/MultiArrayLayout\x82\xa4name\xa4data\xa4type\x92\xa4list\xa6uint64\xa5array\xc3\xbdstd_msgs/msg/MultiArrayLayout\x82\xa6fields\x92\x82\xa4name\xa3dim\xa4type\x92\xa4list\xd9 std_msgs/msg/MultiArrayDimension\x82\xa4name\xabdata_offset\xa4type\xa6uint32\xa5array\xc3\xd9 std_msgs/msg/MultiArrayDimension\x82\xa6fields\x93\x82\xa4name\xa5label\xa4type\xa6string\x82\xa4name\xa4size\xa4type\xa6uint32\x82\xa4name\xa6stride\xa4type\xa6uint32\xa5array\xc3",
    ),
    "rcl_interfaces/msg/ParameterEvent": (
        "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
        b"\x82\xa4root\xd9!rcl_interfaces/msg/ParameterEvent\xa5types\x84\xd9!rcl_interfaces/msg/ParameterEvent\x82\xa6fields\x95\x82\xa4name\xa5stamp\xa4type\xbbbuiltin_interfaces/msg/Time\x82\xa4name\xa4node\xa4type\xa6string\x82\xa4name\xaenew_parameters\xa4type\x92\xa4list\xbcrcl_interfaces/msg/Parameter\x82\xa4name\xb2changed_parameters\xa4type\x92\xa4list\xbcrcl_interfaces/msg/Parameter\x82\xa4name\xb2deleted_parameters\xa4type\x92\xa4list\xbcrcl_interfaces/msg/Parameter\xa5array\xc3\xbbbuiltin_interfaces/msg/Time\x82\xa6fields\x92\x82\xa4name\xa3sec\xa4type\xa5int32\x82\xa4name\xa7nanosec\xa4type\xa6uint32\xa5array\xc3\xbcrcl_interfaces/msg/Parameter\x82\xa6fields\x92\x82\xa4name\xa4name\xa4type\xa6string\x82\xa4name\xa5value\xa4type\xd9!rcl_interfaces/msg/ParameterValue\xa5array\xc3\xd9!rcl_interfaces/msg/ParameterValue\x82\xa6fields\x9a\x82\xa4name\xa4type\xa4type\xa5uint8\x82\xa4name\xaabool_value\xa4type\xa4bool\x82\xa4name\xadinteger_value\xa4type\xa5int64\x82\xa4name\xacdouble_value\xa4type\xa7float64\x82\xa4name\xacstring_value\xa4type\xa6string\x82\xa4name\xb0byte_array_value\xa4type\xa6byte[]\x82\xa4name\xb0bool_array_value\xa4type\x92\xa4list\xa4bool\x82\xa4name\xb3integer_array_value\xa4type\x92\xa4list\xa5int64\x82\xa4name\xb2double_array_value\xa4type\x92\xa4list\xa7float64\x82\xa4name\xb2string_array_value\xa4type\x92\xa4list\xa6string\xa5array\xc3",
    ),
}
