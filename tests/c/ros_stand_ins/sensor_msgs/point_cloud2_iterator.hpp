// A stand-in, see README.md.
#pragma once
#include <string>

#include "sensor_msgs/msg/point_cloud2.hpp"

namespace sensor_msgs {
template <class T>
class PointCloud2ConstIterator {
public:
    PointCloud2ConstIterator(const msg::PointCloud2& cloud, const std::string& name) : step_(cloud.point_step) {
        for (const auto& field : cloud.fields) {
            if (field.name == name) data_ = cloud.data.data() + field.offset;
        }
    }
    const T& operator*() const { return *reinterpret_cast<const T*>(data_); }
    PointCloud2ConstIterator& operator++() {
        data_ += step_;
        return *this;
    }

private:
    const std::uint8_t* data_ = nullptr;
    std::uint32_t step_;
};
}  // namespace sensor_msgs
