"""Message definitions of the ROS package velodyne_msgs."""

SCAN = "velodyne_msgs/msg/VelodyneScan"
MESSAGES = {
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    SCAN: "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets",
}
