// A stand-in, see README.md.
#pragma once
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>

#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__), std::fputc('\n', stderr))
#define RCLCPP_WARN(logger, ...) RCLCPP_ERROR(logger, __VA_ARGS__)

namespace rclcpp {

class Logger {};
class SystemDefaultsQoS {};

class Time {
public:
    explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
    std::int64_t nanoseconds() const { return nanoseconds_; }

private:
    std::int64_t nanoseconds_;
};

class Duration {
public:
    explicit Duration(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
    double seconds() const { return 1e-9 * static_cast<double>(nanoseconds_); }

private:
    std::int64_t nanoseconds_;
};

template <class Message>
class Subscription {
public:
    using SharedPtr = std::shared_ptr<Subscription>;
    std::function<void(std::shared_ptr<const Message>)> callback;
};

}  // namespace rclcpp
