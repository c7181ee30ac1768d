// A stand-in, see README.md.
#pragma once
#include <string>

#include "geometry_msgs/msg/pose_stamped.hpp"

namespace nav_msgs::msg {
struct Odometry {
    std_msgs::msg::Header header;
    std::string child_frame_id;
    struct {
        geometry_msgs::msg::Pose pose;
    } pose;
    struct {
        geometry_msgs::msg::Twist twist;
    } twist;
};
}  // namespace nav_msgs::msg
