// What messages say, in numbers; throws a sentence where they say nothing that can be used.

#ifndef VFFNULL_CONTROLLER__MESSAGES_HPP_
#define VFFNULL_CONTROLLER__MESSAGES_HPP_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "geometry_msgs/msg/pose.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "sensor_msgs/msg/point_cloud2.hpp"
#include "sensor_msgs/point_cloud2_iterator.hpp"
#include "vffnull_controller/law.hpp"

namespace vffnull_controller {

/// Of a message in `frame`, if `base` names one.
inline void in_base(const std::string& frame, const std::string& base) {
    if (!base.empty() && frame != base) {
        throw std::invalid_argument("it is in the frame '" + frame + "', not in '" + base + "'");
    }
}

template <std::size_t N>
void finite(const std::array<double, N>& numbers, const char* what) {
    for (const double each : numbers) {
        if (!std::isfinite(each)) {
            throw std::invalid_argument(std::string(what) + " is not finite");
        }
    }
}

template <class Vector>
std::array<double, 3> three(const Vector& of, const char* what) {
    const std::array<double, 3> numbers{of.x, of.y, of.z};
    finite(numbers, what);
    return numbers;
}

/// w, x, y, z of norm 1.
inline std::array<double, 4> quaternion(const geometry_msgs::msg::Quaternion& of) {
    std::array<double, 4> numbers{of.w, of.x, of.y, of.z};
    finite(numbers, "the orientation");
    const double norm = std::sqrt(of.w * of.w + of.x * of.x + of.y * of.y + of.z * of.z);
    if (std::abs(norm - 1.0) > 0.01) {
        throw std::invalid_argument("the orientation is no unit quaternion");
    }
    for (double& each : numbers) {
        each /= norm;
    }
    return numbers;
}

/// At rest at a pose.
inline Reference reference(const geometry_msgs::msg::Pose& pose) {
    Reference out{};
    const auto position = three(pose.position, "the position");
    const auto orientation = quaternion(pose.orientation);
    std::copy(position.begin(), position.end(), out.begin());
    std::copy(orientation.begin(), orientation.end(), out.begin() + 3);
    return out;
}

/// How a body moves. Its twist is given in its own axes, as `nav_msgs/Odometry` says.
inline Motion motion(const nav_msgs::msg::Odometry& odometry) {
    Motion out;
    out.position = three(odometry.pose.pose.position, "the position");
    out.orientation = quaternion(odometry.pose.pose.orientation);
    const auto [w, x, y, z] = out.orientation;
    const std::array<std::array<double, 3>, 3> rotation{{
        {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
        {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
        {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
    }};
    const auto linear = three(odometry.twist.twist.linear, "the velocity");
    const auto angular = three(odometry.twist.twist.angular, "the angular velocity");
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            out.velocity[i] += rotation[i][k] * linear[k];
            out.angular_velocity[i] += rotation[i][k] * angular[k];
        }
    }
    return out;
}

/// x, y, z of each point that has numbers, at most `most` of them, evenly left out beyond.
inline std::vector<double> points(const sensor_msgs::msg::PointCloud2& cloud, std::size_t most) {
    for (const char* axis : {"x", "y", "z"}) {
        const bool known = std::any_of(cloud.fields.begin(), cloud.fields.end(), [&](const auto& field) {
            return field.name == axis && field.datatype == sensor_msgs::msg::PointField::FLOAT32;
        });
        if (!known) {
            throw std::invalid_argument(std::string("it has no field ") + axis + " of 32-bit numbers");
        }
    }
    const std::size_t count = std::size_t{cloud.width} * cloud.height;
    if (cloud.data.size() < count * cloud.point_step) {
        throw std::invalid_argument("it has fewer bytes than points");
    }
    const std::size_t stride = count <= most ? 1 : (count + most - 1) / most;
    std::vector<double> out;
    out.reserve(3 * std::min(count, most));
    sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
    for (std::size_t i = 0; i < count; ++i, ++x, ++y, ++z) {
        if (i % stride == 0 && std::isfinite(*x) && std::isfinite(*y) && std::isfinite(*z)) {
            out.insert(out.end(), {*x, *y, *z});
        }
    }
    return out;
}

}  // namespace vffnull_controller

#endif  // VFFNULL_CONTROLLER__MESSAGES_HPP_
