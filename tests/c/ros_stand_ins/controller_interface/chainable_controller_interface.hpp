// A stand-in, see README.md.
#pragma once
#include <any>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace rclcpp_lifecycle {

/// What a controller's node is asked for. Subscriptions are kept, so that a test can call them.
class LifecycleNode {
public:
    /// Into `value`, if the parameter is set.
    template <class T>
    void read(const std::string& name, T& value) const {
        if (const auto found = parameters.find(name); found != parameters.end()) value = std::any_cast<T>(found->second);
    }
    const char* get_name() const { return "vffnull_controller"; }
    rclcpp::Logger get_logger() const { return {}; }

    template <class Message, class Callback>
    typename rclcpp::Subscription<Message>::SharedPtr create_subscription(const std::string& topic,
                                                                         const rclcpp::SystemDefaultsQoS&, Callback callback) {
        auto made = std::make_shared<rclcpp::Subscription<Message>>();
        made->callback = std::move(callback);
        subscriptions[topic] = made;
        return made;
    }

    template <class Message>
    void publish(const std::string& topic, Message message) {
        const auto subscription = std::any_cast<typename rclcpp::Subscription<Message>::SharedPtr>(subscriptions.at(topic));
        subscription->callback(std::make_shared<const Message>(std::move(message)));
    }

    std::map<std::string, std::any> parameters;
    std::map<std::string, std::any> subscriptions;
};

}  // namespace rclcpp_lifecycle

namespace hardware_interface {

class LoanedStateInterface {
public:
    explicit LoanedStateInterface(const double* value) : value_(value) {}
    std::optional<double> get_optional() const { return *value_; }

private:
    const double* value_;
};

class LoanedCommandInterface {
public:
    explicit LoanedCommandInterface(double* value) : value_(value) {}
    [[nodiscard]] bool set_value(double value) {
        *value_ = value;
        return true;
    }

private:
    double* value_;
};

class CommandInterface {
public:
    CommandInterface(const std::string& prefix, const std::string& name, double* value) : name_(prefix + "/" + name), value_(value) {}
    const std::string& get_name() const { return name_; }
    [[nodiscard]] bool set_value(double value) {
        *value_ = value;
        return true;
    }

private:
    std::string name_;
    double* value_;
};

}  // namespace hardware_interface

namespace controller_interface {

enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };

struct InterfaceConfiguration {
    interface_configuration_type type = interface_configuration_type::NONE;
    std::vector<std::string> names;
};

class ChainableControllerInterface {
public:
    virtual ~ChainableControllerInterface() = default;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) = 0;
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) = 0;
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) = 0;
    virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State& previous) = 0;

    return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) {
        const bool led = chained_ || update_reference_from_subscribers(time, period) == return_type::OK;
        return led ? update_and_write_commands(time, period) : return_type::ERROR;
    }
    std::vector<hardware_interface::CommandInterface> export_reference_interfaces() { return on_export_reference_interfaces(); }
    bool set_chained_mode(bool chained_mode) {
        const bool done = on_set_chained_mode(chained_mode);
        chained_ = done ? chained_mode : chained_;
        return done;
    }

    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
    unsigned get_update_rate() const { return 1000; }
    void assign_interfaces(std::vector<hardware_interface::LoanedCommandInterface>&& commands,
                           std::vector<hardware_interface::LoanedStateInterface>&& states) {
        command_interfaces_ = std::move(commands);
        state_interfaces_ = std::move(states);
    }

protected:
    virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
    virtual bool on_set_chained_mode(bool chained_mode) = 0;
    virtual return_type update_reference_from_subscribers(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;
    virtual return_type update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;

    std::vector<double> reference_interfaces_;
    std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
    std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
    bool chained_ = false;
};

}  // namespace controller_interface
