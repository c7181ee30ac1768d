// The part that needs no ROS: the law with its buffers, and what is done in a cycle.

#ifndef VFFNULL_CONTROLLER__LAW_HPP_
#define VFFNULL_CONTROLLER__LAW_HPP_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <vffnull.hpp>

namespace vffnull_controller {

/// Where a body is and how it moves, in the axes of the arm's base.
struct Motion {
    std::array<double, 3> position{};                      // [m]
    std::array<double, 4> orientation{1.0, 0.0, 0.0, 0.0};  // w, x, y, z
    std::array<double, 3> velocity{};                      // [m/s]
    std::array<double, 3> angular_velocity{};              // [rad/s]
};

/// What the hand is to do: position [m] and orientation (w, x, y, z), velocity [m/s, rad/s], acceleration [m/s², rad/s²].
constexpr std::size_t POSE = 7, RATE = 6, REFERENCE = POSE + 2 * RATE;
using Reference = std::array<double, REFERENCE>;

class Law {
public:
    /// `robot` is the name of a bundled arm or, if it ends in ".toml", a file. `obstacles` are tables in TOML. A cloud is there if it
    /// may have points, with balls of `radius` [m] around them.
    Law(const std::string& robot, const std::string& settings, const std::vector<std::string>& obstacles, std::size_t points,
        double radius)
        : Law(is_file(robot) ? vff::Robot::from_file(robot) : vff::Robot::named(robot), settings) {
        if (robot_.dimension() != 3) {
            throw std::invalid_argument("robot: expected an arm in space");
        }
        for (const auto& each : obstacles) {
            ids_.push_back(controller_.add_obstacle(each));
            turns_.push_back(each.find("orientation") != std::string::npos);
        }
        if (points > 0) {
            const auto id =
                controller_.add_obstacle("shape = { kind = \"points\", points = [], radius = " + std::to_string(radius) + " }");
            cloud_.emplace(controller_.cloud(id, points));
        }
    }

    std::size_t joints() const noexcept { return q.size(); }

    /// Where points come from, for any thread, as long as this law is there; none without a cloud.
    vff::Cloud* cloud() noexcept { return cloud_ ? &*cloud_ : nullptr; }

    /// Begins where the arm is, at `q`, a loop of `period` seconds. Returns the reference that keeps the hand there.
    Reference begin(double period) {
        controller_.begin(period);
        Reference here{};
        const std::vector<double> pose = robot_.pose(q);
        std::copy(pose.begin(), pose.end(), here.begin());
        if (const auto status = aim(here); !status) {
            throw vff::Error(status.code());
        }
        return here;
    }

    // For the loop.

    /// Writes into `tau` what the arm is left with: nothing, or what holds it against gravity where it is known to be.
    void leave(bool gravity) noexcept {
        const bool known = vff_robot_gravity_torque(robot_.get(), q.data(), q.size(), tau.data(), tau.size()) == VFF_STATUS_OK;
        if (!gravity || !known) {
            std::fill(tau.begin(), tau.end(), 0.0);
        }
    }

    /// A task of positions takes their part of it.
    vff::Status aim(const Reference& reference) noexcept {
        const auto& sizes = controller_.sizes();
        const double* numbers = reference.data();
        return controller_.set_reference({numbers, sizes.pose}, {numbers + POSE, sizes.rate}, {numbers + POSE + RATE, sizes.rate});
    }

    /// Obstacle `i` was seen at time `t` and goes on. The first time that one is turned allocates.
    vff::Status see(std::size_t i, double t, const Motion& seen) noexcept {
        const auto status = controller_.move_obstacle(ids_[i], t, seen.position, seen.velocity);
        const bool level = seen.orientation == Motion{}.orientation && seen.angular_velocity == Motion{}.angular_velocity;
        if (!status || (level && !turns_[i])) {
            return status;
        }
        turns_[i] = 1;
        return controller_.turn_obstacle(ids_[i], t, seen.orientation, seen.angular_velocity);
    }

    /// From `q` and `dq` at time `t` to `tau`, which is to be sent in any case.
    vff::Status cycle(double t, vff_phase& phase) noexcept { return controller_.cycle(t, q, dq, tau, phase); }

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
    std::vector<char> turns_;  // those that are not as they are without being turned
    std::optional<vff::Cloud> cloud_;
};

}  // namespace vffnull_controller

#endif  // VFFNULL_CONTROLLER__LAW_HPP_
