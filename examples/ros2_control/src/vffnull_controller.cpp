#include "vffnull_controller/vffnull_controller.hpp"

#include <algorithm>
#include <exception>
#include <limits>
#include <type_traits>
#include <utility>

#include "pluginlib/class_list_macros.hpp"

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

}  // namespace

InterfaceConfiguration VffnullController::command_interface_configuration() const { return individual(joints_, {"effort"}); }

InterfaceConfiguration VffnullController::state_interface_configuration() const {
    return individual(joints_, {"position", "velocity"});
}

CallbackReturn VffnullController::on_init() {
    auto_declare<std::vector<std::string>>("joints", {});
    auto_declare<std::string>("robot", "");
    auto_declare<std::string>("settings", "");
    auto_declare<std::vector<std::string>>("obstacles", {});
    return CallbackReturn::SUCCESS;
}

CallbackReturn VffnullController::on_configure(const rclcpp_lifecycle::State&) try {
    const auto node = get_node();
    joints_ = node->get_parameter("joints").as_string_array();
    law_ = std::make_unique<Law>(node->get_parameter("robot").as_string(), node->get_parameter("settings").as_string(),
                                 node->get_parameter("obstacles").as_string_array());
    if (law_->joints() != joints_.size()) {
        RCLCPP_ERROR(node->get_logger(), "joints: the robot has %zu, not %zu", law_->joints(), joints_.size());
        return CallbackReturn::ERROR;
    }
    target_topic_ = node->create_subscription<Numbers>(
        "~/target", rclcpp::SystemDefaultsQoS(), [this](const std::shared_ptr<const Numbers> message) {
            const auto& sizes = law_->sizes();
            auto target = std::make_shared<Target>(Target::split(message->data, sizes.pose, sizes.rate));
            if (const char* fault = law_->fault(*target)) {
                RCLCPP_WARN(get_node()->get_logger(), "target: %s", fault);
                return;
            }
            target_.writeFromNonRT(std::move(target));
        });
    obstacle_topic_ = node->create_subscription<Numbers>(
        "~/obstacles", rclcpp::SystemDefaultsQoS(), [this](const std::shared_ptr<const Numbers> message) {
            obstacles_.writeFromNonRT(std::make_shared<std::vector<double>>(message->data));
        });
    return CallbackReturn::SUCCESS;
} catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
}

CallbackReturn VffnullController::on_activate(const rclcpp_lifecycle::State&) try {
    if (!read()) {
        RCLCPP_ERROR(get_node()->get_logger(), "there is no state to begin with");
        return CallbackReturn::ERROR;
    }
    law_->begin(1.0 / get_update_rate());
    target_.writeFromNonRT(nullptr);  // what was wanted before is not wanted any more
    obstacles_.writeFromNonRT(nullptr);
    aimed_.reset();
    seen_.reset();
    start_ = get_node()->now().seconds();
    return CallbackReturn::SUCCESS;
} catch (const std::exception& error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
}

CallbackReturn VffnullController::on_deactivate(const rclcpp_lifecycle::State&) {
    // The next controller takes over from here. Before it does, command a stop if your arm needs one: `law_->stop()`, and
    // cycles until the phase is VFF_PHASE_FINISHED.
    return CallbackReturn::SUCCESS;
}

return_type VffnullController::update(const rclcpp::Time& time, const rclcpp::Duration&) {
    const double t = time.seconds() - start_;
    const auto target = *target_.readFromRT();
    if (target && target != aimed_ && law_->aim(*target)) {
        aimed_ = target;
    }
    const auto seen = *obstacles_.readFromRT();
    if (seen && seen != seen_ && law_->see(t, *seen)) {
        seen_ = seen;
    }
    read();  // what is no number counts as missing, and the watchdog sees to it
    vff_phase phase{};
    if (!law_->cycle(t, phase)) {
        return return_type::ERROR;
    }
    for (std::size_t i = 0; i < joints_.size(); ++i) {
        static_cast<void>(command_interfaces_[i].set_value(law_->tau[i]));
    }
    return phase == VFF_PHASE_LOST ? return_type::ERROR : return_type::OK;
}

/// Takes over positions and velocities, which come in turn. Whether all are numbers.
bool VffnullController::read() {
    bool sound = true;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
        law_->q[i] = value_of(state_interfaces_[2 * i]);
        law_->dq[i] = value_of(state_interfaces_[2 * i + 1]);
        sound &= law_->q[i] == law_->q[i] && law_->dq[i] == law_->dq[i];
    }
    return sound;
}

}  // namespace vffnull_controller

PLUGINLIB_EXPORT_CLASS(vffnull_controller::VffnullController, controller_interface::ControllerInterface)
