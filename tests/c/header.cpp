// What the C++ header promises of its types, checked by the compiler.

#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>
#include <vffnull.hpp>

using vff::Cloud;
using vff::Controller;
using vff::Robot;

static_assert(!std::is_copy_constructible_v<Robot> && std::is_nothrow_move_constructible_v<Robot>);
static_assert(!std::is_copy_constructible_v<Controller> && std::is_nothrow_move_constructible_v<Controller>);
static_assert(!std::is_copy_constructible_v<Cloud> && std::is_nothrow_move_assignable_v<Cloud>);

static_assert(noexcept(std::declval<Controller&>().observe(0.0, {}, {})));
static_assert(noexcept(std::declval<Controller&>().torque({})));
static_assert(noexcept(std::declval<Controller&>().cycle({}, std::declval<vff_phase&>())));
static_assert(noexcept(std::declval<Controller&>().set_point(0.0, {}, {}, {}, std::declval<vff_course&>())));
static_assert(noexcept(std::declval<Controller&>().set_reference({})));
static_assert(noexcept(std::declval<Controller&>().move_obstacle(0, 0.0, {})));
static_assert(noexcept(std::declval<Controller&>().succeed(std::declval<Controller&>())));
static_assert(noexcept(std::declval<Controller&>().turn_obstacle(0, 0.0, {})));
static_assert(noexcept(std::declval<const Controller&>().distances(0, {})));
static_assert(noexcept(std::declval<const Controller&>().terms(std::declval<vff::Terms&>())));

static_assert(std::is_convertible_v<const std::vector<double>&, vff::Input>);
static_assert(std::is_convertible_v<std::vector<double>&, vff::Output>);
static_assert(std::is_convertible_v<double (&)[7], vff::Output>);
static_assert(!std::is_convertible_v<const std::vector<double>&, vff::Output>, "what is constant is not written to");
static_assert(!std::is_convertible_v<std::vector<float>&, vff::Input>);

int main() {
    // Faults are thrown with their sentence where something is made, and returned in the loop.
    try {
        Robot::named("pandas");
        return 1;
    } catch (const vff::Error& error) {
        if (error.code() != VFF_STATUS_DOCUMENT || std::string(error.what()).find("panda") == std::string::npos) return 2;
    }
    Controller first(Robot::named("panda"), "task = 'pose'");
    Controller controller = std::move(first);
    std::vector<double> q(7), short_q(6), tau(7);
    if (controller.observe(0.0, q, short_q).code() != VFF_STATUS_LENGTH) return 3;
    if (controller.observe(0.0, short_q, q).code() != VFF_STATUS_LENGTH) return 4;
    if (std::string(vff::message()) != "q: expected 7 numbers, got 6") return 5;
    if (controller.torque(tau).code() != VFF_STATUS_NOT_OBSERVED) return 6;
    const auto id = controller.add_obstacle("shape = { kind = 'points', points = [], radius = 0.01 }");
    Cloud cloud = controller.cloud(id, 2);
    cloud.update(std::vector<double>(6, 0.5));
    try {
        cloud.update(std::vector<double>(9, 0.5));
        return 7;
    } catch (const vff::Error& error) {
        if (error.code() != VFF_STATUS_TOO_MANY) return 8;
    }
    if (!controller.observe(0.0, q, q) || !controller.set_reference(Robot::named("panda").pose(q))) return 9;
    if (!controller.torque(tau) || controller.null_projector().size() != 49) return 10;
    if (controller.obstacles() != std::vector<std::uint32_t>{id}) return 11;
    vff_phase phase = VFF_PHASE_LOST;
    vff_course course = VFF_COURSE_WAITING;
    if (controller.cycle(tau, phase).code() != VFF_STATUS_NOT_BEGUN) return 13;
    controller.begin(0.001);
    if (controller.cycle(0.0, q, short_q, tau, phase).code() != VFF_STATUS_LENGTH) return 14;
    if (!controller.cycle(0.0, q, q, tau, phase) || phase != VFF_PHASE_STARTING) return 15;
    if (!controller.cycle(tau, phase) || phase != VFF_PHASE_HOLDING || !controller.stop()) return 16;
    controller.begin_set_points(0.001, q, std::vector<double>(7, 5.0), std::vector<double>(7, 1000.0));
    std::vector<double> x(7), dx(7), ddx(7);
    if (!controller.set_point(0.0, x, dx, ddx, course) || course != VFF_COURSE_FOLLOWING) return 17;
    if (controller.set_point(0.0, x, dx, ddx, course, q, short_q).code() != VFF_STATUS_LENGTH) return 18;
    try {
        controller.begin_set_points(0.001, q, std::vector<double>(7, 0.0), std::vector<double>(7, 1.0));
        return 19;
    } catch (const vff::Error& error) {
        if (error.code() != VFF_STATUS_DOCUMENT) return 20;
    }
    if (!controller.warnings().empty()) return 21;
    controller.add_obstacle("shape = { kind = 'sphere', radius = 0.05 }\nposition = [400.0, 0.0, 300.0]");
    const std::vector<std::string> warnings = controller.warnings();
    if (warnings.size() != 1 || warnings[0].find("millimetres?") == std::string::npos) return 22;
    // Where the tip gets, another law in a loop that runs, and an obstacle that turns.
    const Robot robot = Robot::named("panda");
    const std::vector<double> ready = {0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8}, still(7);
    std::vector<double> torque(7), row(7), gradient(49), there = ready;
    if (robot.jacobian(ready).size() != 42) return 23;
    there[0] += 0.1;
    const auto gap = robot.inverse_kinematics(robot.pose(ready), there);
    if (gap[0] > 1e-6 || gap[1] > 1e-6) return 24;
    const std::string at_once = "task = 'pose'\ncommand = { blend_time = 0.0 }\n";
    Controller loop(robot, at_once);
    const auto bar = loop.add_obstacle("shape = { kind = 'box', size = [0.4, 0.1, 0.1] }\nposition = [0, 0.6, 0.6]");
    loop.begin(0.001);
    if (!loop.cycle(0.0, ready, still, torque, phase)) return 25;
    const std::vector<double> turn = {0.0, 0.0, 0.0, 1.0}, rate = {0.0, 0.0, 0.5};
    if (!loop.turn_obstacle(bar, 0.0, turn, rate) || loop.turn_obstacle(bar, 0.0, turn, turn)) return 26;
    if (!loop.distances(bar, row, gradient) || !loop.distances(bar, row) || loop.distances(bar, row, row)) return 27;
    Controller next = loop.successor(robot.with_load(1.0, {0.0, 0.0, 0.05}), at_once + "stiffness = 30");
    if (!loop.succeed(next) || !loop.cycle(0.001, ready, still, torque, phase)) return 28;
    // What is empty is not given, wherever its memory is.
    std::vector<double> none(49, 1.0);
    none.clear();
    if (!loop.move_obstacle(bar, 0.001, std::vector<double>{0.0, 0.6, 0.6}, none) || !loop.turn_obstacle(bar, 0.001, turn, none) ||
        !loop.distances(bar, row, none) || !loop.set_reference(robot.pose(ready), none, none)) {
        return 37;
    }
    const std::vector<double> before = row;
    if (!loop.observe(0.9, ready, still) || !loop.distances(bar, row) || row != before) return 38;
    double path_time = 0.0;
    if (loop.planned(row, path_time) || !(loop.stable_period(0.0, ready) > 0.0)) return 29;
    // What a camera sees.
    vff::Perceiver eyes(robot,
                        "[[cameras]]\ncolumns = 4\nrows = 3\nfocal = [4.0, 4.0]\ncentre = [1.5, 1.0]\n"
                        "position = [0.6, 0.6, 1.2]\norientation = [0.0, 1.0, 0.0, 0.0]\n"
                        "[settings]\nstride = 1\nleast_points = 1\n");
    const std::vector<std::uint16_t> depth(12, 900);
    const std::vector<float> metres(12, 0.9F);
    vff_picture_counts counts{};
    if (eyes.see(depth.data(), 3, 4, 0.0).code() != VFF_STATUS_NOT_OBSERVED) return 30;
    if (!eyes.observe(0.0, ready, still) || eyes.observe(0.01, ready, short_q)) return 31;
    if (!eyes.see(depth.data(), 3, 4, 0.0, 0, 0, &counts) || counts.measured != 12) return 32;
    if (!eyes.observe(0.03, ready, still) || !eyes.see(metres.data(), 3, 4, 0.03)) return 33;
    if (!eyes.see_points(std::vector<double>{0.0, 0.0, 0.9}, 0.04) || eyes.see_points(still, 0.05)) return 34;
    if (eyes.points().size() != eyes.velocities().size() || eyes.points().empty() || eyes.t() != 0.04) return 35;
    const auto seen = loop.add_obstacle("shape = { kind = 'points', points = [], radius = 0.02 }");
    const vff::Cloud seen_cloud = loop.cloud(seen, 100);
    if (!eyes.send(seen_cloud) || !(eyes.radius() > 0.0)) return 36;
    return first.get() == nullptr ? 0 : 12;
}
