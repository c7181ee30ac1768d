// The torque law of vffnull in a loop of your own, for C++17. See docs/c.md.
//
// Handles are move-only and free what they own. What makes them, and what is not for the loop, throws `vff::Error`; what is
// for the loop is `noexcept` and returns a status.

#ifndef VFFNULL_HPP
#define VFFNULL_HPP

#include <array>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "vffnull.h"

namespace vff {

/// Numbers that lie side by side and belong to somebody else: an array, a vector, or a pointer with a length. Where there are none,
/// its `data()` is NULL, as of what is not given.
template <class T>
class Span {
public:
    constexpr Span() noexcept = default;
    constexpr Span(T* data, std::size_t size) noexcept : data_(size > 0 ? data : nullptr), size_(size) {}
    template <std::size_t N>
    constexpr Span(T (&array)[N]) noexcept : data_(array), size_(N) {}
    /// Of whatever has `data()` and `size()`: `std::array`, `std::vector`, `std::span`, a column of Eigen. Of what does not lie side by
    /// side, such as a row of one, the length is one that every call refuses.
    template <class C,
              class = std::enable_if_t<
                  !std::is_same_v<std::decay_t<C>, Span> &&
                  std::is_convertible_v<std::remove_pointer_t<decltype(std::declval<C&>().data())> (*)[], T (*)[]>>>
    constexpr Span(C&& values) noexcept
        : Span(values.data(), lies_side_by_side(values, 0) ? static_cast<std::size_t>(values.size()) : scattered) {}

    /// The size of what does not lie side by side: no multiple of the coordinates of a point.
    static constexpr std::size_t scattered = static_cast<std::size_t>(-2);

    constexpr T* data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T& operator[](std::size_t i) const noexcept { return data_[i]; }
    constexpr T* begin() const noexcept { return data_; }
    constexpr T* end() const noexcept { return data_ + size_; }

private:
    /// As Eigen tells it.
    template <class C>
    static constexpr auto lies_side_by_side(const C& values, int) noexcept
        -> decltype(values.innerStride(), values.outerStride(), values.innerSize(), values.outerSize(), true) {
        return (values.size() <= 1 || values.innerStride() == 1) &&
               (values.outerSize() <= 1 || values.outerStride() == values.innerSize());
    }
    template <class C>
    static constexpr bool lies_side_by_side(const C&, long) noexcept {
        return true;
    }

    T* data_ = nullptr;
    std::size_t size_ = 0;
};

using Input = Span<const double>;
using Output = Span<double>;

/// What a call in the loop came to: true if all is well.
class [[nodiscard]] Status {
public:
    constexpr Status(vff_status code) noexcept : code_(code) {}
    constexpr explicit operator bool() const noexcept { return code_ == VFF_STATUS_OK; }
    constexpr vff_status code() const noexcept { return code_; }
    /// Such as "VFF_STATUS_LENGTH".
    const char* name() const noexcept { return vff_status_name(code_); }

private:
    vff_status code_;
};

/// The sentence of the last fault of this thread.
inline const char* message() noexcept { return vff_last_message(); }

/// What is thrown where something is made.
class Error : public std::runtime_error {
public:
    explicit Error(vff_status code) : std::runtime_error(vff_last_message()), code_(code) {}
    vff_status code() const noexcept { return code_; }

private:
    vff_status code_;
};

namespace detail {

inline void check(vff_status code) {
    if (code != VFF_STATUS_OK) {
        throw Error(code);
    }
}

struct Free {
    void operator()(vff_robot* robot) const noexcept { vff_robot_free(robot); }
    void operator()(vff_controller* controller) const noexcept { vff_controller_free(controller); }
    void operator()(vff_cloud* cloud) const noexcept { vff_cloud_free(cloud); }
    void operator()(vff_perceiver* perceiver) const noexcept { vff_perceiver_free(perceiver); }
};

template <class T>
using Handle = std::unique_ptr<T, Free>;

/// The object that `make` hands out.
template <class T, class Make>
Handle<T> made(Make make) {
    if (vff_abi_version() != VFF_ABI_VERSION) {
        throw std::runtime_error(std::string("libvffnull ") + vff_version() +
                                 " has another binary interface than the header that this program was compiled with");
    }
    T* handle = nullptr;
    check(make(&handle));
    return Handle<T>(handle);
}

}  // namespace detail

/// A robot arm. It never changes: any number of threads may use one.
class Robot {
public:
    /// From the TOML of `vffnull arms check ROBOT.urdf --toml`.
    static Robot from_text(const std::string& toml) {
        return Robot([&](vff_robot** out) { return vff_robot_from_text(toml.c_str(), out); });
    }
    static Robot from_file(const std::string& path) {
        return Robot([&](vff_robot** out) { return vff_robot_from_file(path.c_str(), out); });
    }
    /// A bundled one, such as "panda".
    static Robot named(const std::string& name) {
        return Robot([&](vff_robot** out) { return vff_robot_named(name.c_str(), out); });
    }

    std::size_t joints() const noexcept { return vff_robot_joints(get()); }
    std::size_t dimension() const noexcept { return vff_robot_dimension(get()); }

    /// The pose of the tip at q: position [m], then quaternion (w, x, y, z), in the plane angle [rad].
    std::vector<double> pose(Input q) const {
        std::vector<double> out(dimension() == 3 ? 7 : 3);
        detail::check(vff_robot_pose(get(), q.data(), q.size(), out.data(), out.size()));
        return out;
    }
    /// The torque that holds the arm at q [N·m].
    std::vector<double> gravity_torque(Input q) const {
        std::vector<double> out(joints());
        detail::check(vff_robot_gravity_torque(get(), q.data(), q.size(), out.data(), out.size()));
        return out;
    }
    /// The mass matrix at q, n × n [kg·m²].
    std::vector<double> mass_matrix(Input q) const {
        std::vector<double> out(joints() * joints());
        detail::check(vff_robot_mass_matrix(get(), q.data(), q.size(), out.data(), out.size()));
        return out;
    }

    /// The Jacobian of the tip at q, row by row: 6 × n, linear before angular in world axes; 2 × n in the plane.
    std::vector<double> jacobian(Input q) const {
        std::vector<double> out((dimension() == 3 ? 6 : 2) * joints());
        detail::check(vff_robot_jacobian(get(), q.data(), q.size(), out.data(), out.size()));
        return out;
    }
    /// Moves q to the nearest posture for a position, or for a pose; returns how far the tip stays away [m, rad].
    std::array<double, 2> inverse_kinematics(Input pose, Output q) const {
        std::array<double, 2> gap{};
        detail::check(vff_robot_inverse_kinematics(get(), pose.data(), pose.size(), q.data(), q.size(), gap.data()));
        return gap;
    }
    /// The same robot with a body at its tip: mass [kg], centre of mass [m], moments of inertia [kg·m²].
    Robot with_load(double mass, const std::array<double, 3>& com = {}, const std::array<double, 6>& inertia = {}) const {
        return Robot([&](vff_robot** out) { return vff_robot_with_load(get(), mass, com.data(), inertia.data(), out); });
    }

    const vff_robot* get() const noexcept { return handle_.get(); }

private:
    template <class Make>
    explicit Robot(Make make) : handle_(detail::made<vff_robot>(make)) {}

    detail::Handle<vff_robot> handle_;
};

/// The parts of a torque; valid until the next call with the controller.
struct Terms : vff_terms {
    Input torque() const noexcept { return {tau, joints}; }
    Input task_torque() const noexcept { return {tau_task, joints}; }
    Input null_torque() const noexcept { return {tau_null, joints}; }
    Input repulsion() const noexcept { return {tau_vff, joints}; }
    Input forces() const noexcept { return {force, joints}; }
    Input clearances() const noexcept { return {clearance, joints}; }
    /// Of the link that is nearest to an obstacle [m].
    double least_clearance() const noexcept {
        double least = self_clearance;
        for (double each : clearances()) {
            least = each < least ? each : least;
        }
        return least;
    }
};

/// Where the points of a cloud come from. Any thread may use it, also while another is in a call with the controller.
class Cloud {
public:
    /// Replaces the points: x, y, z of each [m], relative to the obstacle's position. Takes effect in the next `observe`.
    void update(Input xyz) {
        if (xyz.size() % 3 != 0) {
            throw std::invalid_argument("points: expected three numbers each");
        }
        detail::check(vff_cloud_update(handle_.get(), xyz.data(), xyz.size() / 3));
    }
    /// The same of points that were there at time `t` [s] and go on at velocities: x, y, z of each [m/s].
    void update(Input xyz, Input velocities, double t) {
        if (xyz.size() % 3 != 0 || velocities.size() != xyz.size()) {
            throw std::invalid_argument("points, velocities: expected three numbers each, and as many");
        }
        detail::check(
            vff_cloud_update_moving(handle_.get(), xyz.data(), velocities.data(), xyz.size() / 3, t));
    }

private:
    friend class Controller;
    friend class Perceiver;
    explicit Cloud(detail::Handle<vff_cloud> handle) : handle_(std::move(handle)) {}

    detail::Handle<vff_cloud> handle_;
};

/// From pictures of depth cameras to a cloud of moving points. One thread at a time may use it, beside the loop.
class Perceiver {
public:
    /// Around a robot, with the TOML of its cameras, settings and what is known.
    Perceiver(const Robot& robot, const std::string& toml)
        : handle_(detail::made<vff_perceiver>(
              [&](vff_perceiver** out) { return vff_perceiver_new(robot.get(), toml.c_str(), out); })) {}

    /// A state of the arm at time `t` [s], later than the last.
    Status observe(double t, Input q, Input dq) noexcept {
        if (q.size() != dq.size()) {
            return VFF_STATUS_LENGTH;
        }
        return vff_perceiver_observe(handle_.get(), t, q.data(), dq.data(), q.size());
    }
    /// A picture in whole millimetres, taken at time `t` [s]; rows begin `row_bytes` after each other, without a gap by default.
    Status see(const std::uint16_t* depth, std::size_t rows, std::size_t columns, double t, std::size_t camera = 0,
               std::size_t row_bytes = 0, vff_picture_counts* counts = nullptr) noexcept {
        const std::size_t step = row_bytes != 0 ? row_bytes : columns * sizeof *depth;
        return vff_perceiver_see_millimetres(handle_.get(), camera, t, depth, rows, columns, step, counts);
    }
    /// The same in metres.
    Status see(const float* depth, std::size_t rows, std::size_t columns, double t, std::size_t camera = 0,
               std::size_t row_bytes = 0, vff_picture_counts* counts = nullptr) noexcept {
        const std::size_t step = row_bytes != 0 ? row_bytes : columns * sizeof *depth;
        return vff_perceiver_see_metres(handle_.get(), camera, t, depth, rows, columns, step, counts);
    }
    /// Points that a camera saw, in its frame: x, y, z of each [m].
    Status see_points(Input xyz, double t, std::size_t camera = 0, vff_picture_counts* counts = nullptr) noexcept {
        if (xyz.size() % 3 != 0) {
            return VFF_STATUS_LENGTH;
        }
        return vff_perceiver_see_points(handle_.get(), camera, t, xyz.data(), xyz.size() / 3, counts);
    }
    /// Replaces the points of a cloud by those of the last picture, with their velocities.
    Status send(const Cloud& cloud) const noexcept { return vff_perceiver_send(handle_.get(), cloud.handle_.get()); }

    /// The points at the time of the last picture: x, y, z of each [m].
    std::vector<double> points() const { return read().first; }
    /// At which velocities they go on [m/s].
    std::vector<double> velocities() const { return read().second; }
    /// The time of the last picture [s]; NaN before the first.
    double t() const {
        double t = 0.0;
        detail::check(vff_perceiver_size(handle_.get(), nullptr, &t, nullptr));
        return t;
    }
    /// A radius at which balls at the points cover what was seen [m].
    double radius() const {
        double radius = 0.0;
        detail::check(vff_perceiver_size(handle_.get(), nullptr, nullptr, &radius));
        return radius;
    }

private:
    std::pair<std::vector<double>, std::vector<double>> read() const {
        std::size_t count = 0;
        detail::check(vff_perceiver_size(handle_.get(), &count, nullptr, nullptr));
        std::pair<std::vector<double>, std::vector<double>> found{std::vector<double>(3 * count),
                                                                  std::vector<double>(3 * count)};
        // A vector without numbers may have no place.
        double none = 0.0;
        double* const points = count != 0 ? found.first.data() : &none;
        detail::check(vff_perceiver_points(handle_.get(), points, found.second.data(), count));
        return found;
    }

    detail::Handle<vff_perceiver> handle_;
};

/// The torque law. One thread at a time may use it. Once per cycle: `observe`, then `torque`.
class Controller {
public:
    /// For a robot, with the TOML of its settings, among no obstacles.
    explicit Controller(const Robot& robot, const std::string& settings = "")
        : Controller([&](vff_controller** out) { return vff_controller_new(robot.get(), settings.c_str(), out); }) {}
    /// From a whole scenario.
    static Controller from_scenario(const std::string& toml) {
        return Controller([&](vff_controller** out) { return vff_controller_from_scenario(toml.c_str(), out); });
    }
    static Controller from_scenario_file(const std::string& path) {
        return Controller([&](vff_controller** out) { return vff_controller_from_scenario_file(path.c_str(), out); });
    }

    std::size_t joints() const noexcept { return sizes_.joints; }
    const vff_sizes& sizes() const noexcept { return sizes_; }

    // Not for the loop.

    /// Throws if the gains are unstable where a torque is held for `period` seconds.
    void check_period(double period) const { detail::check(vff_controller_check_period(get(), period)); }
    /// Adds an obstacle from TOML; returns its number. Observe the state again before the next torque.
    std::uint32_t add_obstacle(const std::string& toml) {
        std::uint32_t id = 0;
        detail::check(vff_controller_add_obstacle(get(), toml.c_str(), &id));
        return id;
    }
    /// What is allowed but probably not meant in its scenario and in obstacles that were added, in sentences.
    std::vector<std::string> warnings() const {
        std::vector<std::string> out;
        while (const char* sentence = vff_controller_warning(get(), out.size())) {
            out.emplace_back(sentence);
        }
        return out;
    }
    void remove_obstacle(std::uint32_t id) { detail::check(vff_controller_remove_obstacle(get(), id)); }
    std::vector<std::uint32_t> obstacles() const {
        std::size_t count = 0;
        detail::check(vff_controller_obstacles(get(), nullptr, 0, &count));
        std::vector<std::uint32_t> ids(count);
        detail::check(vff_controller_obstacles(get(), ids.data(), ids.size(), &count));
        return ids;
    }
    /// A handle by which other threads replace the points of cloud `id`, by at most `most` others.
    Cloud cloud(std::uint32_t id, std::size_t most) {
        return Cloud(
            detail::made<vff_cloud>([&](vff_cloud** out) { return vff_controller_cloud(get(), id, most, out); }));
    }
    /// Begins a loop of `period` seconds that is watched over: see `cycle`. Its torque is blended in from the measured one [N·m].
    void begin(double period, Input measured = {}) {
        detail::check(vff_controller_begin(get(), period, measured.data(), measured.size()));
    }
    /// Begins a loop of `period` seconds with a robot that takes positions or velocities and is at rest at q: see `set_point`.
    /// Without speeds, those of the arm hold.
    void begin_set_points(double period, Input q, Input acceleration, Input jerk, Input speed = {}, double threshold = 0.1) {
        if (acceleration.size() != joints() || jerk.size() != joints() || !(speed.empty() || speed.size() == joints())) {
            throw std::invalid_argument("limits: expected a number per joint");
        }
        const vff_set_point_limits limits{speed.data(), acceleration.data(), jerk.data(), threshold};
        detail::check(vff_controller_begin_set_points(get(), period, &limits, q.data(), q.size()));
    }
    /// A law that can take the place of this one while the loop runs: see `succeed`.
    Controller successor(const Robot& robot, const std::string& settings = "") const {
        return Controller([&](vff_controller** out) {
            return vff_controller_successor(get(), robot.get(), settings.c_str(), out);
        });
    }
    /// How long a torque may be held at q and time t [s] before the null space oscillates [s].
    double stable_period(double t, Input q) {
        double period = 0.0;
        detail::check(vff_controller_stable_period(get(), t, q.data(), q.size(), &period));
        return period;
    }
    /// n × n numbers, row by row.
    std::vector<double> null_projector() const {
        std::vector<double> out(joints() * joints());
        detail::check(vff_controller_null_projector(get(), out.data(), out.size()));
        return out;
    }

    // For the loop.

    /// Takes in the state at time t [s].
    Status observe(double t, Input q, Input dq) noexcept {
        // Of two lengths the one that is wrong, if one is.
        return vff_controller_observe(get(), t, q.data(), dq.data(), q.size() == joints() ? dq.size() : q.size());
    }
    /// Takes in what the robot measures of the torque from outside [N·m], for the states that come.
    Status sense(Input tau_ext) noexcept { return vff_controller_sense(get(), tau_ext.data(), tau_ext.size()); }
    /// The torque from outside as estimated at the observed state [N·m].
    Status external_torque(Output out) noexcept { return vff_controller_external_torque(get(), out.data(), out.size()); }
    /// The link on which a contact is felt, or one beyond it, counted from 0; -1 while none is felt.
    Status touched_link(std::int32_t &link) const noexcept { return vff_controller_touched_link(get(), &link); }
    /// The observed pose of the end effector.
    Status pose(Output out) const noexcept { return vff_controller_pose(get(), out.data(), out.size()); }
    /// The reference from now on; velocity and acceleration are 0 if they are not given.
    Status set_reference(Input x, Input dx = {}, Input ddx = {}) noexcept {
        return vff_controller_set_reference(get(), x.data(), x.size(), dx.data(), dx.size(), ddx.data(), ddx.size());
    }
    Status follow_scenario() noexcept { return vff_controller_follow_scenario(get()); }
    /// The joint torque at the observed state [N·m].
    Status torque(Output tau) noexcept { return vff_controller_torque(get(), tau.data(), tau.size()); }
    /// One cycle of a loop that has begun, with the state of time t [s], whatever it is: what is to be sent [N·m].
    Status cycle(double t, Input q, Input dq, Output tau, vff_phase& phase) noexcept {
        // One length for all three: that of the one that is wrong.
        const std::size_t size = q.size() != joints() ? q.size() : dq.size() != joints() ? dq.size() : tau.size();
        return vff_controller_cycle(get(), t, q.data(), dq.data(), tau.data(), size, &phase);
    }
    /// One without a state.
    Status cycle(Output tau, vff_phase& phase) noexcept {
        return vff_controller_cycle(get(), 0.0, nullptr, nullptr, tau.data(), tau.size(), &phase);
    }
    /// The next set point of a robot that takes them, from that for the time t [s]; `measured` is its state, if it is known.
    Status set_point(double t, Output q, Output dq, Output ddq, vff_course& course, Input measured_q = {},
                     Input measured_dq = {}) noexcept {
        const bool all = q.size() == joints() && dq.size() == joints() && ddq.size() == joints();
        const bool known = measured_q.size() == joints() && measured_dq.size() == joints();
        const std::size_t size = all && (known || (measured_q.empty() && measured_dq.empty())) ? joints() : 0;
        return vff_controller_set_point(get(), t, measured_q.data(), measured_dq.data(), q.data(), dq.data(), ddq.data(), size,
                                        &course);
    }
    /// Ends the loop safely: `phase` will be `VFF_PHASE_FINISHED`.
    Status stop() noexcept { return vff_controller_stop(get()); }
    /// What was left out since the loop began, for lack of time or because of a bound.
    Status left_out(vff_left_out& counts) const noexcept { return vff_controller_left_out(get(), &counts); }
    Status terms(Terms& out) const noexcept { return vff_controller_terms(get(), &out); }
    /// Obstacle `id` is at `position` at time t and goes on at `velocity`.
    Status move_obstacle(std::uint32_t id, double t, Input position, Input velocity = {}) noexcept {
        const bool first = velocity.empty() || position.size() != sizes_.dimension;
        const std::size_t size = first ? position.size() : velocity.size();
        return vff_controller_move_obstacle(get(), id, t, position.data(), velocity.data(), size);
    }
    /// Obstacle `id` has this orientation at time t and turns on at `rate`: quaternion and angular velocity, in the plane angle and
    /// rate.
    Status turn_obstacle(std::uint32_t id, double t, Input orientation, Input rate = {}) noexcept {
        const bool wrong = !rate.empty() && rate.size() != (sizes_.dimension == 3 ? 3u : 1u);
        return vff_controller_turn_obstacle(get(), id, t, orientation.data(), wrong ? 0 : orientation.size(), rate.data());
    }
    /// The distance of every link from obstacle `id` at the observed state [m], and its gradient, n × n, if there is room for it.
    Status distances(std::uint32_t id, Output out, Output gradient = {}) const noexcept {
        const bool right = gradient.empty() || gradient.size() == joints() * joints();
        return vff_controller_distances(get(), id, out.data(), right ? out.size() : 0, gradient.data());
    }
    /// Where the plan that is followed has the joints, and where its clock is [s].
    Status planned(Output q, double& path_time) const noexcept {
        return vff_controller_planned(get(), q.data(), q.size(), &path_time);
    }
    /// `next`, which `successor` has made, takes the place of the law within `duration` [s], without a step of the torque.
    Status succeed(Controller& next, double duration = 0.5) noexcept {
        return vff_controller_succeed(get(), next.get(), duration);
    }
    /// Forgets the past, and leaves a loop that is over, which allocates.
    Status reset() noexcept { return vff_controller_reset(get()); }

    vff_controller* get() const noexcept { return handle_.get(); }

private:
    template <class Make, class = std::enable_if_t<std::is_invocable_v<Make, vff_controller**>>>
    explicit Controller(Make make) : handle_(detail::made<vff_controller>(make)) {
        detail::check(vff_controller_sizes(get(), &sizes_));
    }

    detail::Handle<vff_controller> handle_;
    vff_sizes sizes_{};
};

}  // namespace vff

#endif  // VFFNULL_HPP
