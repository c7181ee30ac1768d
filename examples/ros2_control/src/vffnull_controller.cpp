#include "vffnull_controller/vffnull_controller.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>

#include "pluginlib/class_list_macros.hpp"
#include "vffnull_controller/messages.hpp"

namespace vffnull_controller {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

namespace {

InterfaceConfiguration individual(const std::vector<std::string>& joints, const std::vector<std::string>& kinds) {
    InterfaceConfiguration wanted;
    wanted.type = controller_interface::interface_configuration_type::INDIVIDUAL;
    for (const auto& joint : joints) {
        for (const auto& kind : kinds) {
            wanted.names.push_back(joint + "/" + kind);
        }
    }
    return wanted;
}

// `get_value` of older releases has become `get_optional`.
template <class Interface, class = void>
struct has_optional : std::false_type {};
template <class Interface>
struct has_optional<Interface, std::void_t<decltype(std::declval<const Interface&>().get_optional())>> : std::true_type {};

template <class Interface>
double value_of(const Interface& interface) {
    if constexpr (has_optional<Interface>::value) {
        return interface.get_optional().value_or(std::numeric_limits<double>::quiet_NaN());  // counts as missing
    } else {
        return interface.get_value();
    }
}

std::vector<std::string> reference_names() {
    std::vector<std::string> names{"position.x",    "position.y",    "position.z",   "orientation.w",
                                   "orientation.x", "orientation.y", "orientation.z"};
    for (const std::string of : {"velocity", "acceleration"}) {
        for (const std::string part : {".linear", ".angular"}) {
            for (const std::string axis : {".x", ".y", ".z"}) {
                names.push_back(of + part + axis);
            }
        }
    }
    return names;
}

constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

/// For how long a body has gone on since it was seen [s]: 0 of a stamp that is missing, to come, or of another clock.
double age_of(std::int64_t stamp, const rclcpp::Time& now) {
    const double age = 1e-9 * static_cast<double>(now.nanoseconds() - stamp);
    return stamp != 0 && age > 0.0 && age < 1.0 ? age : 0.0;
}

template <class Stamp>
std::int64_t nanoseconds(const Stamp& stamp) {
    return 1'000'000'000 * std::int64_t{stamp.sec} + std::int64_t{stamp.nanosec};
}

}  // namespace

InterfaceConfiguration VffnullController::command_interface_configuration() const { return individual(parameters_.joints, {"effort"}); }

InterfaceConfiguration VffnullController::state_interface_configuration() const {
    return individual(parameters_.joints, {"position", "velocity"});
}

CallbackReturn VffnullController::on_init() try {
    listener_ = std::make_shared<ParamListener>(get_node());
    return CallbackReturn::SUCCESS;
} catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
}

CallbackReturn VffnullController::on_configure(const rclcpp_lifecycle::State&) try {
    const auto node = get_node();
    parameters_ = listener_->get_params();
    std::vector<std::string> tables;
    for (const auto& name : parameters_.obstacles) {
        tables.push_back(parameters_.obstacle.obstacles_map.at(name).toml);
    }
    const auto most = static_cast<std::size_t>(parameters_.points.most);
    law_ = std::make_shared<Law>(parameters_.robot, parameters_.settings, tables, most, parameters_.points.radius);
    if (law_->joints() != parameters_.joints.size()) {
        RCLCPP_ERROR(node->get_logger(), "joints: the robot has %zu, not %zu", law_->joints(), parameters_.joints.size());
        return CallbackReturn::ERROR;
    }
    obstacles_.resize(parameters_.obstacles.size());

    const auto qos = rclcpp::SystemDefaultsQoS();
    const auto refused = [logger = node->get_logger()](const char* topic, const std::exception& error) {
        RCLCPP_WARN(logger, "%s: a message is left out: %s", topic, error.what());
    };
    target_topic_ = node->create_subscription<geometry_msgs::msg::PoseStamped>(
        "~/target", qos, [this, refused](const std::shared_ptr<const geometry_msgs::msg::PoseStamped> message) {
            try {
                in_base(message->header.frame_id, parameters_.base_frame);
                target_.send(reference(message->pose), nanoseconds(message->header.stamp));
            } catch (const std::exception& error) {
                refused("target", error);
            }
        });
    obstacle_topic_ = node->create_subscription<nav_msgs::msg::Odometry>(
        "~/obstacles", qos, [this, refused](const std::shared_ptr<const nav_msgs::msg::Odometry> message) {
            try {
                in_base(message->header.frame_id, parameters_.base_frame);
                const auto& names = parameters_.obstacles;
                const auto named = std::find(names.begin(), names.end(), message->child_frame_id);
                if (named == names.end()) {
                    throw std::invalid_argument("there is no obstacle '" + message->child_frame_id + "'");
                }
                const auto place = static_cast<std::size_t>(named - names.begin());
                obstacles_[place].send(motion(*message), nanoseconds(message->header.stamp));
            } catch (const std::exception& error) {
                refused("obstacles", error);
            }
        });
    if (most > 0) {
        // It keeps the law that it fills, should another be configured meanwhile.
        point_topic_ = node->create_subscription<sensor_msgs::msg::PointCloud2>(
            "~/points", qos,
            [law = law_, most, base = parameters_.base_frame, refused](const std::shared_ptr<const sensor_msgs::msg::PointCloud2> message) {
                try {
                    in_base(message->header.frame_id, base);
                    law->cloud()->update(points(*message, most));
                } catch (const std::exception& error) {
                    refused("points", error);
                }
            });
    }
    return CallbackReturn::SUCCESS;
} catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
}

CallbackReturn VffnullController::on_cleanup(const rclcpp_lifecycle::State&) {
    target_topic_.reset();
    obstacle_topic_.reset();
    point_topic_.reset();
    obstacles_.clear();
    law_.reset();
    return CallbackReturn::SUCCESS;
}

std::vector<hardware_interface::CommandInterface> VffnullController::on_export_reference_interfaces() {
    const auto names = reference_names();
    reference_interfaces_.assign(names.size(), NONE);
    std::vector<hardware_interface::CommandInterface> exported;
    for (std::size_t i = 0; i < names.size(); ++i) {
        exported.emplace_back(get_node()->get_name(), names[i], &reference_interfaces_[i]);
    }
    return exported;
}

bool VffnullController::on_set_chained_mode(bool) {
    std::fill(reference_interfaces_.begin(), reference_interfaces_.end(), NONE);  // what led before leads no more
    return true;
}

CallbackReturn VffnullController::on_activate(const rclcpp_lifecycle::State&) try {
    if (!read()) {
        RCLCPP_ERROR(get_node()->get_logger(), "there is no state to begin with");
        return CallbackReturn::ERROR;
    }
    held_ = law_->begin(1.0 / get_update_rate());
    std::fill(reference_interfaces_.begin(), reference_interfaces_.end(), NONE);
    target_.take();  // what was wanted before is not wanted any more; time goes on, as obstacles do
    return CallbackReturn::SUCCESS;
} catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
}

CallbackReturn VffnullController::on_deactivate(const rclcpp_lifecycle::State&) {
    read();
    law_->leave(parameters_.effort_when_deactivated == "gravity");
    write();
    return CallbackReturn::SUCCESS;
}

return_type VffnullController::update_reference_from_subscribers(const rclcpp::Time&, const rclcpp::Duration&) {
    if (const auto* target = target_.take()) {
        std::copy(target->value.begin(), target->value.end(), reference_interfaces_.begin());
    }
    return return_type::OK;
}

return_type VffnullController::update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration& period) {
    t_ += period.seconds();
    // A pose that is not complete leaves the hand where it is to be; rates that are not given are 0.
    const auto wanted = reference_interfaces_.begin();
    if (std::all_of(wanted, wanted + POSE, [](double each) { return std::isfinite(each); })) {
        std::transform(wanted, wanted + REFERENCE, held_.begin(), [](double each) { return std::isfinite(each) ? each : 0.0; });
    } else {
        std::fill(held_.begin() + POSE, held_.end(), 0.0);
    }
    static_cast<void>(law_->aim(held_));  // one that cannot be meant leaves the last one
    for (std::size_t i = 0; i < obstacles_.size(); ++i) {
        if (const auto* seen = obstacles_[i].take()) {
            static_cast<void>(law_->see(i, t_ - age_of(seen->stamp, time), seen->value));
        }
    }
    read();  // what is no number counts as missing, and the watchdog sees to it
    vff_phase phase{};
    if (!law_->cycle(t_, phase)) {
        return return_type::ERROR;
    }
    write();
    return phase == VFF_PHASE_LOST ? return_type::ERROR : return_type::OK;
}

/// Takes over positions and velocities, which come in turn. Whether all are numbers.
bool VffnullController::read() {
    bool sound = true;
    for (std::size_t i = 0; i < law_->joints(); ++i) {
        law_->q[i] = value_of(state_interfaces_[2 * i]);
        law_->dq[i] = value_of(state_interfaces_[2 * i + 1]);
        sound &= std::isfinite(law_->q[i]) && std::isfinite(law_->dq[i]);
    }
    return sound;
}

void VffnullController::write() {
    for (std::size_t i = 0; i < law_->joints(); ++i) {
        static_cast<void>(command_interfaces_[i].set_value(law_->tau[i]));
    }
}

}  // namespace vffnull_controller

PLUGINLIB_EXPORT_CLASS(vffnull_controller::VffnullController, controller_interface::ChainableControllerInterface)
