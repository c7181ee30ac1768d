// A stand-in, see README.md.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "geometry_msgs/msg/pose_stamped.hpp"

namespace sensor_msgs::msg {
struct PointField {
    static constexpr std::uint8_t FLOAT32 = 7, FLOAT64 = 8;
    std::string name;
    std::uint32_t offset = 0;
    std::uint8_t datatype = 0;
    std::uint32_t count = 0;
};
struct PointCloud2 {
    std_msgs::msg::Header header;
    std::uint32_t height = 0, width = 0;
    std::vector<PointField> fields;
    std::uint32_t point_step = 0;
    std::vector<std::uint8_t> data;
};
}  // namespace sensor_msgs::msg
