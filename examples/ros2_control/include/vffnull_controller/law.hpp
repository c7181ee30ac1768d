// The part that needs no ROS: the law with its buffers, and what is done in a cycle.

#ifndef VFFNULL_CONTROLLER__LAW_HPP_
#define VFFNULL_CONTROLLER__LAW_HPP_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <vffnull.hpp>

namespace vffnull_controller {

/// Pose, velocity and acceleration of the hand: see `vff_sizes`. The last two may be empty.
struct Target {
    std::vector<double> pose, velocity, acceleration;

    /// Numbers one after the other: `pose` of them, then `rate` and `rate` as far as they are there.
    static Target split(const std::vector<double>& numbers, std::size_t pose, std::size_t rate) {
        const auto part = [&](std::size_t from, std::size_t to) {
            const auto at = [&](std::size_t i) { return numbers.begin() + static_cast<std::ptrdiff_t>(std::min(i, numbers.size())); };
            return std::vector<double>(at(from), at(to));
        };
        return {part(0, pose), part(pose, pose + rate), part(pose + rate, numbers.size())};
    }
};

class Law {
public:
    /// `robot` is the name of a bundled arm or, if it ends in ".toml", a file.
    Law(const std::string& robot, const std::string& settings, const std::vector<std::string>& obstacles)
        : Law(is_file(robot) ? vff::Robot::from_file(robot) : vff::Robot::named(robot), settings) {
        for (const auto& each : obstacles) {
            ids_.push_back(controller_.add_obstacle(each));
        }
    }

    std::size_t joints() const noexcept { return q.size(); }
    std::size_t dimension() const noexcept { return controller_.sizes().dimension; }
    const vff_sizes& sizes() const noexcept { return controller_.sizes(); }

    /// What is wrong with a target, or nothing.
    const char* fault(const Target& target) const noexcept {
        const auto fits = [&](const std::vector<double>& given) { return given.empty() || given.size() == sizes().rate; };
        if (target.pose.size() != sizes().pose) return "a pose has another length";
        return fits(target.velocity) && fits(target.acceleration) ? nullptr : "a rate has another length";
    }

    /// Begins where the arm is, at `q`: the hand stays there until there is a target.
    void begin(double period) {
        controller_.begin(period);
        const std::vector<double> here = robot_.pose(q);  // of which a position is the beginning
        if (const auto status = controller_.set_reference({here.data(), sizes().pose}); !status) {
            throw vff::Error(status.code());
        }
    }

    // For the loop.

    vff::Status aim(const Target& target) noexcept {
        return controller_.set_reference(target.pose, target.velocity, target.acceleration);
    }

    /// Obstacles as they were seen at time `t`: position and velocity of each, one after the other.
    vff::Status see(double t, const std::vector<double>& seen) noexcept {
        const std::size_t size = dimension(), count = std::min(seen.size() / (2 * size), ids_.size());
        vff::Status status = VFF_STATUS_OK;
        for (std::size_t i = 0; i < count && status; ++i) {
            const double* at = seen.data() + 2 * size * i;
            status = controller_.move_obstacle(ids_[i], t, {at, size}, {at + size, size});
        }
        return status;
    }

    /// From `q` and `dq` at time `t` to `tau`, which is to be sent in any case.
    vff::Status cycle(double t, vff_phase& phase) noexcept { return controller_.cycle(t, q, dq, tau, phase); }

    vff::Status stop() noexcept { return controller_.stop(); }

    std::vector<double> q, dq, tau;

private:
    Law(vff::Robot&& robot, const std::string& settings)
        : q(robot.joints()), dq(robot.joints()), tau(robot.joints()), robot_(std::move(robot)), controller_(robot_, settings) {}

    static bool is_file(const std::string& name) {
        const std::string ending = ".toml";
        return name.size() > ending.size() && name.compare(name.size() - ending.size(), ending.size(), ending) == 0;
    }

    vff::Robot robot_;
    vff::Controller controller_;
    std::vector<std::uint32_t> ids_;
};

}  // namespace vffnull_controller

#endif  // VFFNULL_CONTROLLER__LAW_HPP_
