// The torque law of vffnull in a loop of your own. See docs/c.md.
//
// Written by cbindgen from crates/vff-c; `vffnull.hpp` is the same for C++17.

#ifndef VFFNULL_H
#define VFFNULL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Number of the binary interface. It changes when a program has to be compiled again.
#define VFF_ABI_VERSION 1

// What a call came to. Whatever is not `VFF_STATUS_OK` has changed nothing, has written nothing, and has left a sentence in
// `vff_last_message`.
enum vff_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Done.
    VFF_STATUS_OK = 0,
    // A pointer is NULL that must not be.
    VFF_STATUS_NULL = 1,
    // An array has the wrong length.
    VFF_STATUS_LENGTH = 2,
    // A number is infinite or not a number, or a period that is not greater than 0.
    VFF_STATUS_NOT_FINITE = 3,
    // A text or what it describes is not what it must be. The message says where.
    VFF_STATUS_DOCUMENT = 4,
    // A file cannot be read.
    VFF_STATUS_FILE = 5,
    // The numbers are no reference, pose or orientation: the quaternion is not of norm 1. Or the robot is not where the reference of the
    // scenario begins.
    VFF_STATUS_REFERENCE = 6,
    // There is no reference yet.
    VFF_STATUS_NO_REFERENCE = 7,
    // No state was observed since the last torque or change of the obstacles, or there is no torque yet.
    VFF_STATUS_NOT_OBSERVED = 8,
    // There is no such obstacle.
    VFF_STATUS_NO_OBSTACLE = 9,
    // The obstacle is no cloud of points, or not any longer.
    VFF_STATUS_NOT_A_CLOUD = 10,
    // More than there is room for.
    VFF_STATUS_TOO_MANY = 11,
    // A torque held over that period makes the arm oscillate.
    VFF_STATUS_PERIOD = 12,
    // The torque is not finite: state and reference are beyond what numbers can hold. The next call begins anew, which allocates.
    VFF_STATUS_TORQUE = 13,
    // Another thread is in a call with the same object.
    VFF_STATUS_BUSY = 14,
    // A fault of vffnull itself, please report it. The object can be freed, and nothing else.
    VFF_STATUS_PANIC = 15,
    // No loop has begun.
    VFF_STATUS_NOT_BEGUN = 16,
    // The law before is still being left, or blended in.
    VFF_STATUS_SUCCEEDING = 17,
    // A time is not later than the last one.
    VFF_STATUS_NOT_LATER = 18,
    // There is no such camera.
    VFF_STATUS_NO_CAMERA = 19,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum vff_status vff_status;
#else
typedef int32_t vff_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What a cycle of a loop came to.
enum vff_phase
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The torque is being blended in: at a safe start, and after an interruption.
    VFF_PHASE_STARTING = 0,
    // The torque of the law is sent.
    VFF_PHASE_RUNNING = 1,
    // The state is missing, for fewer than `command.missed_cycles` cycles: what was sent last is held.
    VFF_PHASE_HOLDING = 2,
    // The state is missing for longer, the torque of the law is not finite, or a joint is faster than twice its limit: the arm is
    // damped and, at a state that comes, held once it is slow.
    VFF_PHASE_DAMPING = 3,
    // It has been missing for longer still: nothing is sent but gravity, if it is ours.
    VFF_PHASE_RELEASED = 4,
    // The loop is over: the state did not come back. Another beginning leads out of this, or `vff_controller_reset`.
    VFF_PHASE_LOST = 5,
    // The end was asked for: the arm is damped and, once it is slow, held, until it stands.
    VFF_PHASE_STOPPING = 6,
    // The loop is over: the arm stands, and is held as long as there are cycles.
    VFF_PHASE_FINISHED = 7,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum vff_phase vff_phase;
#else
typedef int32_t vff_phase;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What a set point comes from.
enum vff_course
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // From the law.
    VFF_COURSE_FOLLOWING = 0,
    // A joint and its set point were farther apart than the threshold: the set point comes to the robot.
    VFF_COURSE_REJOINING = 1,
    // The robot has not been heard of for 20 cycles, or the torque of the law is not finite: the set point stops.
    VFF_COURSE_WAITING = 2,
    // The end was asked for: the set point stops.
    VFF_COURSE_STOPPING = 3,
    // It stands.
    VFF_COURSE_FINISHED = 4,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum vff_course vff_course;
#else
typedef int32_t vff_course;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Where the points of a cloud come from. Any thread may use it, also while another is in a call with the controller.
typedef struct vff_cloud vff_cloud;

// The torque law of one robot. One thread at a time may use it; a call that finds another one in progress comes to
// `VFF_STATUS_BUSY`.
//
// Once per cycle: `vff_controller_observe`, then `vff_controller_torque`. What is said to be "for the loop" allocates nothing,
// takes no lock, makes no system call and does not wait (with `formulation = "recursive"`, the default).
typedef struct vff_controller vff_controller;

// Makes a cloud of moving points of what depth cameras see around an arm. One thread at a time may use it, beside the loop; a call
// that finds another one in progress comes to `VFF_STATUS_BUSY`. All of its calls allocate.
typedef struct vff_perceiver vff_perceiver;

// A robot arm. It never changes: any number of threads may use one.
typedef struct vff_robot vff_robot;

// Sizes of a controller.
typedef struct vff_sizes {
    // The number of joints n.
    size_t joints;
    // The dimension of the space, 2 or 3.
    size_t dimension;
    // How many numbers a pose has. In the plane 2, or with the task "pose" 3: (x, y, angle). In space 3, or with "pose" or "pointing"
    // 7: position and quaternion (w, x, y, z).
    size_t pose;
    // How many its velocity has, and its acceleration: linear, then angular in world axes. 2 or 3; 3 or 6.
    size_t rate;
} vff_sizes;

// What a loop has left out since it began: for lack of time before the `deadline`, or because of a bound.
typedef struct vff_left_out {
    // Cycles that took longer than the deadline.
    uint64_t late;
    // Cycles in which the look-ahead stopped for lack of time.
    uint64_t cut;
    // Roll-outs that it did not make because of that.
    uint64_t rollouts;
    // Points of clouds beyond the 64 that `cbf` keeps of a link, counted once a cycle.
    uint64_t points;
    // Programs that ended with constraints left.
    uint64_t programs;
} vff_left_out;

// What the joints of a robot that takes positions or velocities may do.
typedef struct vff_set_point_limits {
    // Largest speeds, n numbers [rad/s, m/s]; NULL for those of the arm.
    const double *speed;
    // Largest accelerations, n numbers [rad/s², m/s²].
    const double *acceleration;
    // Largest jerks, n numbers [rad/s³, m/s³].
    const double *jerk;
    // How far a joint of the robot may be from its set point [rad, m].
    double threshold;
} vff_set_point_limits;

// The parts of the last torque. Arrays have n numbers and are valid until the next call with the controller but
// `vff_controller_terms`.
typedef struct vff_terms {
    // The number of joints n.
    size_t joints;
    // Joint torque of the law, whatever `command` makes of it [N·m].
    const double *tau;
    // What serves the task, and what makes it give way [N·m].
    const double *tau_task;
    // What acts in the null space [N·m].
    const double *tau_null;
    // Repulsion before its projection [N·m].
    const double *tau_vff;
    // Magnitude of the repulsion on each link [N].
    const double *force;
    // Signed distance of each link's surface to the nearest obstacle's [m]; infinite without one.
    const double *clearance;
    // Energies: kinetic, gravitational, of the null space [J].
    double energy[3];
    // Powers of actuators, damping, task, obstacles, approach, scaling [W].
    double power[6];
    // What the limits let through of posture, task, damping, avoidance, compensation, speed; 0 to 1.
    double objective_scale[6];
    // By how much barriers are violated at most [m/s²]; NaN without `avoidance = "cbf"`.
    double slack;
    // Energy in the tank [J]; NaN without one.
    double tank;
    // Signed distance of the nearest two links that share no joint [m]; infinite if not measured.
    double self_clearance;
    // √det(J Jᵀ), 0 in a singularity.
    double manipulability;
    // ‖J M⁻¹ τ_null‖ [m/s²]: what leaks into the task.
    double null_acceleration;
    // Whether the task force is damped because of a singularity.
    bool singular;
} vff_terms;

// What became of the points of a picture.
typedef struct vff_picture_counts {
    // Pixels that were looked at and had a depth.
    size_t measured;
    // Of these those that were cut away as the arm.
    size_t own;
    // Of these those that there was no room for.
    size_t left_out;
    // Cells that are remembered, and not seen in this picture.
    size_t remembered;
} vff_picture_counts;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// `VFF_ABI_VERSION` of the library that is loaded: compare it with that of the header.
uint32_t vff_abi_version(void);

// The version of vffnull, such as "0.1.0".
const char *vff_version(void);

// The name of a status, such as "VFF_STATUS_OK"; "?" for a number that is none.
const char *vff_status_name(int32_t status);

// The sentence of the last fault of the calling thread; empty if there was none. It is valid until the next one.
const char *vff_last_message(void);

// A robot from TOML: the table `arm` of a scenario, alone or under that name. `vffnull arms check ROBOT.urdf --toml` writes
// it for a URDF or MJCF, `vffnull arms show panda --toml` for a bundled arm. Free it with `vff_robot_free`.
vff_status vff_robot_from_text(const char *toml,
                               struct vff_robot **robot);

// The same from a file.
vff_status vff_robot_from_file(const char *path, struct vff_robot **robot);

// A bundled robot: "panda", "fr3", "ur5e", "ur10e", "iiwa14", "gen3" or "xarm7".
vff_status vff_robot_named(const char *name, struct vff_robot **robot);

// Frees a robot. Its controllers may live on. NULL is nothing.
void vff_robot_free(struct vff_robot *robot);

// The number of joints n; 0 for NULL.
size_t vff_robot_joints(const struct vff_robot *robot);

// The dimension of the space that it moves in, 2 or 3; 0 for NULL.
size_t vff_robot_dimension(const struct vff_robot *robot);

// The pose of the tip at q: in space position [m] and quaternion (w, x, y, z), 7 numbers; in the plane position [m] and angle
// [rad], 3 numbers. Allocates.
vff_status vff_robot_pose(const struct vff_robot *robot,
                          const double *q,
                          size_t joints,
                          double *pose,
                          size_t length);

// The torque that holds the arm against gravity at q, n numbers [N·m]: to be compared with that of the robot. Allocates.
vff_status vff_robot_gravity_torque(const struct vff_robot *robot,
                                    const double *q,
                                    size_t joints,
                                    double *tau,
                                    size_t length);

// The mass matrix at q, n × n numbers [kg·m²]: to be compared with that of the maker. Allocates.
vff_status vff_robot_mass_matrix(const struct vff_robot *robot,
                                 const double *q,
                                 size_t joints,
                                 double *mass,
                                 size_t length);

// The Jacobian of the tip at q, row by row: in space 6 × n numbers, linear then angular in world axes; in the plane 2 × n, of its
// position. Allocates.
vff_status vff_robot_jacobian(const struct vff_robot *robot,
                              const double *q,
                              size_t joints,
                              double *jacobian,
                              size_t length);

// A posture in which the tip has this pose: a position [m], or position and orientation, as `vff_robot_pose` writes it. Moves `q`,
// where the search begins, to the nearest posture within the joint limits that it finds, from there and from elsewhere, and writes to
// `gap`, two numbers, how far the tip stays away [m, rad]: below 1e-6 both, it is there. Allocates.
vff_status vff_robot_inverse_kinematics(const struct vff_robot *robot,
                                        const double *pose,
                                        size_t length,
                                        double *q,
                                        size_t joints,
                                        double *gap);

// The same robot with a body at its tip, as part of its last link: a mass [kg], its centre of mass in the frame of the tool [m], and its
// moments of inertia xx, yy, zz, xy, xz, yz about that [kg·m²]; NULL is 0, and in the plane a load is a point. Free it with
// `vff_robot_free`.
vff_status vff_robot_with_load(const struct vff_robot *robot,
                               double mass,
                               const double *com,
                               const double *inertia,
                               struct vff_robot **loaded);

// A controller for a robot, among no obstacles. `settings` is TOML: the table `controller` of a scenario, alone or under that
// name; NULL for the defaults. Free it with `vff_controller_free`.
vff_status vff_controller_new(const struct vff_robot *robot,
                              const char *settings,
                              struct vff_controller **controller);

// A controller from the TOML of a whole scenario: its arm, settings, obstacles (numbered from 0) and reference, a plan with its posture
// and margins, which waits with `governor`. It is that of the time t, or, in a loop that is watched over, begins when the torque has
// been blended in. Plant, sensors, drives and `replan` of a scenario are for simulations.
vff_status vff_controller_from_scenario(const char *toml,
                                        struct vff_controller **controller);

// The same from a file.
vff_status vff_controller_from_scenario_file(const char *path, struct vff_controller **controller);

// The sentence about the `index`th thing, from 0, that is allowed but probably not meant in the scenario of the controller or in an obstacle
// that was added: an obstacle in millimetres, a quaternion with w in the last place, a reference out of reach that is followed
// nevertheless. NULL where there are no more. It is valid until the controller is freed.
const char *vff_controller_warning(const struct vff_controller *controller,
                                   size_t index);

// Frees a controller. No thread may be in a call with it; handles of its clouds live on and come to `VFF_STATUS_NOT_A_CLOUD`.
// NULL is nothing.
void vff_controller_free(struct vff_controller *controller);

// The sizes of the arrays of a controller.
vff_status vff_controller_sizes(const struct vff_controller *controller, struct vff_sizes *sizes);

// Whether its gains are stable where a torque is held for `period` seconds; if not, `VFF_STATUS_PERIOD`, and the message says
// which. Allocates.
vff_status vff_controller_check_period(const struct vff_controller *controller,
                                       double period);

// For the loop: takes in the state at time `t` [s], q [rad, m] and dq [rad/s, m/s], n numbers each. Obstacles are moved to `t`,
// and clouds that were updated meanwhile take effect.
vff_status vff_controller_observe(struct vff_controller *controller,
                                  double t,
                                  const double *q,
                                  const double *dq,
                                  size_t joints);

// For the loop: takes in what the robot measures of the torque that its surroundings exert on the joints, n numbers [N·m, N], for
// the states that come, with `observer.source = "measured"`. A Franka's `tau_ext_hat_filtered` counts what the robot exerts: its
// negative belongs here. One that is not finite changes nothing.
vff_status vff_controller_sense(struct vff_controller *controller,
                                const double *tau_ext,
                                size_t joints);

// For the loop: the torque from outside as estimated at the observed state, n numbers [N·m, N]; zeros without an observer.
vff_status vff_controller_external_torque(struct vff_controller *controller,
                                          double *tau_ext,
                                          size_t joints);

// For the loop: the link on which a contact is felt at the observed state, or one beyond it, counted from 0; −1 while none is felt,
// and without `observer.detection`.
vff_status vff_controller_touched_link(const struct vff_controller *controller,
                                       int32_t *link);

// For the loop: the pose of the end effector at the observed state, as many numbers as `sizes.pose`.
vff_status vff_controller_pose(const struct vff_controller *controller, double *pose, size_t length);

// For the loop: the reference of the end effector from now on, until another is set: pose, velocity and acceleration.
// The last two may be NULL with length 0, which means 0. Lengths are `sizes.pose`, `sizes.rate` and `sizes.rate`.
vff_status vff_controller_set_reference(struct vff_controller *controller,
                                        const double *x,
                                        size_t x_length,
                                        const double *dx,
                                        size_t dx_length,
                                        const double *ddx,
                                        size_t ddx_length);

// For the loop: the reference is that of the scenario again.
vff_status vff_controller_follow_scenario(struct vff_controller *controller);

// For the loop: the joint torque at the observed state, n numbers [N·m, N], as the settings' `command` wants it, but for its rate,
// which `vff_controller_cycle` limits. Each needs an observation of its own.
vff_status vff_controller_torque(struct vff_controller *controller,
                                 double *tau,
                                 size_t joints);

// For the loop: forgets the past: an energy tank is as full as at the start, a look-ahead follows no candidate, and the
// next state may be at any time. Obstacles and reference stay. A loop that is over, of torques or of set points, is left by it, which
// allocates and frees: what is asked from then on is asked of the law of torques, by a clock that may be another one.
vff_status vff_controller_reset(struct vff_controller *controller);

// Begins a loop of `period` seconds that is watched over: from now on `vff_controller_cycle` says what is to be sent. The torque is
// blended in from the `measured` one, n numbers [N·m, N] that contain gravity only if what is sent does, or, if that is NULL with
// length 0 or cannot be, from what holds the arm still. Until the first state the measured one is sent, or nothing. A loop of set points
// is over then. Allocates.
vff_status vff_controller_begin(struct vff_controller *controller,
                                double period,
                                const double *measured,
                                size_t joints);

// For the loop: one cycle with the state that was measured at time `t` [s], n numbers each, or with none, if q and dq are NULL.
// Writes what is to be sent, n numbers [N·m, N], and what the cycle came to. The state may be anything: one that is missing,
// no newer than the last, not finite, or not to be reached from the last counts as missing. What is to be sent is finite, within the
// torque limits and the rate of `command`, and does not depend on other states that are observed in between. Without a reference, the
// motion of the end effector is damped. A loop that would begin far beyond the stops, or not where the reference of
// the scenario begins, is refused (`VFF_STATUS_REFERENCE`): nothing is to be sent.
vff_status vff_controller_cycle(struct vff_controller *controller,
                                double t,
                                const double *q,
                                const double *dq,
                                double *tau,
                                size_t joints,
                                vff_phase *phase);

// For the loop: what was left out since it began, or the last `vff_controller_reset`.
vff_status vff_controller_left_out(const struct vff_controller *controller, struct vff_left_out *left_out);

// For the loop: ends it safely. From the next cycle on the arm, or its set point, is damped until it stands.
vff_status vff_controller_stop(struct vff_controller *controller);

// A law that can take the place of that of `controller` while its loop runs: for a robot, with other loads or another tool, and with
// settings as in `vff_controller_new`, whose `task` and `command` are those of `controller`. It has room for the obstacles of that; make it
// anew when they have changed. Free it with `vff_controller_free`. Allocates.
vff_status vff_controller_successor(const struct vff_controller *controller,
                                    const struct vff_robot *robot,
                                    const char *settings,
                                    struct vff_controller **successor);

// For the loop: `successor` takes the place of the law of `controller` within `duration` [s], in which the torque goes over from the one to
// the other without a step. `successor` then has what is left, and can be freed and nothing else. Obstacles, reference and loop of
// `controller` stay. With another tool a reference means another tip from then on; where a plan is followed, that allocates. While the
// last succession is under way, or the torque is blended in, it comes to `VFF_STATUS_SUCCEEDING`.
vff_status vff_controller_succeed(struct vff_controller *controller,
                                  struct vff_controller *successor,
                                  double duration);

// For the loop: where the plan that is followed has the joints, n numbers [rad, m], and where its clock is [s], which waits with
// `governor`; that may be NULL. `VFF_STATUS_NO_REFERENCE` if the reference of the scenario is no plan.
vff_status vff_controller_planned(const struct vff_controller *controller,
                                  double *q,
                                  size_t joints,
                                  double *path_time);

// For the loop: the distance of every link from obstacle `id` at the observed state, n numbers [m], infinite of one without a shape, and
// in `gradient`, n × n numbers, how it changes with the joints [m/rad, m/m]; that may be NULL.
vff_status vff_controller_distances(const struct vff_controller *controller,
                                    uint32_t id,
                                    double *distance,
                                    size_t joints,
                                    double *gradient);

// How long a torque may be held at q and time `t` [s], at rest, before the null space oscillates (T34) [s]; infinite where nothing makes it.
// Allocates.
vff_status vff_controller_stable_period(struct vff_controller *controller,
                                        double t,
                                        const double *q,
                                        size_t joints,
                                        double *period);

// Begins a loop of `period` seconds with a robot that takes positions or velocities and is at rest at q, n numbers: the closed loop
// runs on the model, whose state is the set point. The past is forgotten, and the reference of a scenario begins `command.blend_time`
// after the first set point, at whatever time that is. A robot that is far beyond its stops, or not where that reference begins, is
// refused (`VFF_STATUS_REFERENCE`). A loop of torques that was watched over is over then, and torques that are asked for are those
// from which set points are made, and change none, until `vff_controller_begin`, or `vff_controller_reset` after they have finished.
// Allocates.
vff_status vff_controller_begin_set_points(struct vff_controller *controller,
                                           double period,
                                           const struct vff_set_point_limits *limits,
                                           const double *q,
                                           size_t joints);

// For the loop: one cycle, from the set point for the time `t` [s] to the next. Writes its angles, velocities and accelerations, n
// numbers each, and what it comes from. `measured_q` and `measured_dq` are the state of the robot; NULL, both, or numbers that are none
// mean that it has not been heard of. Without a reference, the motion of the end effector is damped.
vff_status vff_controller_set_point(struct vff_controller *controller,
                                    double t,
                                    const double *measured_q,
                                    const double *measured_dq,
                                    double *q,
                                    double *dq,
                                    double *ddq,
                                    size_t joints,
                                    vff_course *course);

// For the loop: the parts of the last torque.
vff_status vff_controller_terms(const struct vff_controller *controller, struct vff_terms *terms);

// The null-space projector at the observed state, n × n numbers, row by row. Allocates.
vff_status vff_controller_null_projector(const struct vff_controller *controller, double *projector, size_t length);

// Adds an obstacle from TOML: one of the tables `obstacles` of a scenario. `id` gets its number, which stays its own; it may be
// NULL. Allocates, so that no later torque does for it; observe the state again before the next torque. What is odd about the obstacle
// joins the warnings of `vff_controller_warning`.
vff_status vff_controller_add_obstacle(struct vff_controller *controller,
                                       const char *toml,
                                       uint32_t *id);

// For the loop: obstacle `id` is at `position` [m] at time `t` [s] and goes on at `velocity` [m/s] until it is moved again;
// NULL is at rest. `dimension` is their length. It turns as before. With `command.obstacle_speed`, one that cannot have come there since
// it was moved last goes there at that speed. The first time, what a motion of way points took is freed.
vff_status vff_controller_move_obstacle(struct vff_controller *controller,
                                        uint32_t id,
                                        double t,
                                        const double *position,
                                        const double *velocity,
                                        size_t dimension);

// For the loop: obstacle `id` has this orientation at time `t` [s], and turns on at `rate` until it is turned again; NULL is at rest. In space
// a unit quaternion (w, x, y, z) and 3 numbers, an angular velocity in world axes [rad/s]; in the plane an angle [rad] and its rate, one
// number each. `length` is that of the orientation. It moves as before. Of one that has not turned before, it allocates.
vff_status vff_controller_turn_obstacle(struct vff_controller *controller,
                                        uint32_t id,
                                        double t,
                                        const double *orientation,
                                        size_t length,
                                        const double *rate);

// Takes obstacle `id` away. Frees memory; observe the state again before the next torque.
vff_status vff_controller_remove_obstacle(struct vff_controller *controller, uint32_t id);

// The numbers of the obstacles, ascending: writes at most `room` of them to `ids`, which may be NULL if that is 0, and to
// `count` how many there are.
vff_status vff_controller_obstacles(const struct vff_controller *controller,
                                    uint32_t *ids,
                                    size_t room,
                                    size_t *count);

// A handle by which other threads replace the points of obstacle `id`, `shape = { kind = "points", … }` in its TOML, by at most
// `most` others (50 000). Allocates room for them, so that no later torque does; observe the state again before the next
// torque. Free it with `vff_cloud_free`.
vff_status vff_controller_cloud(struct vff_controller *controller,
                                uint32_t id,
                                size_t most,
                                struct vff_cloud **cloud);

// Replaces the points of the cloud by these, `count` times (x, y, z) [m], relative to the obstacle's position. They take effect
// together in the next `vff_controller_observe`, unless others are sent before. Prepares them here, in the calling thread, and
// neither waits for the loop nor lets it wait. Allocates, and frees the points of before.
vff_status vff_cloud_update(const struct vff_cloud *cloud,
                            const double *points,
                            size_t count);

// The same of points that were there at time `t` [s], on the clock of `vff_controller_observe`, and go on from there at
// `velocities`, `count` times (x, y, z) [m/s], until others take their place.
vff_status vff_cloud_update_moving(const struct vff_cloud *cloud,
                                   const double *points,
                                   const double *velocities,
                                   size_t count,
                                   double t);

// Frees the handle, not the cloud. NULL is nothing.
void vff_cloud_free(struct vff_cloud *cloud);

// A perceiver around a robot in space, from TOML: tables `cameras` with `columns`, `rows`, `focal`, `centre`, `distortion` (k₁, k₂, p₁,
// p₂, k₃), `position` [m] and `orientation` (w, x, y, z) of a frame whose z looks forward and y down; a table `settings`, those of
// `vffnull.Perceiver`; and tables `known`, obstacles that the cloud does not repeat. Free it with `vff_perceiver_free`.
vff_status vff_perceiver_new(const struct vff_robot *robot,
                             const char *toml,
                             struct vff_perceiver **perceiver);

// Takes in a state of the arm at time `t` [s], later than the last. A picture needs one near its time.
vff_status vff_perceiver_observe(const struct vff_perceiver *perceiver,
                                 double t,
                                 const double *q,
                                 const double *dq,
                                 size_t joints);

// Takes in a picture that a camera took at time `t` [s], in whole millimetres; 0 was not measured. Rows begin `row_bytes` bytes after each
// other: `2 * columns`, or what a driver calls step or stride. `counts` may be NULL.
vff_status vff_perceiver_see_millimetres(const struct vff_perceiver *perceiver,
                                         size_t camera,
                                         double t,
                                         const uint16_t *depth,
                                         size_t rows,
                                         size_t columns,
                                         size_t row_bytes,
                                         struct vff_picture_counts *counts);

// The same in metres; what is no positive number was not measured.
vff_status vff_perceiver_see_metres(const struct vff_perceiver *perceiver,
                                    size_t camera,
                                    double t,
                                    const float *depth,
                                    size_t rows,
                                    size_t columns,
                                    size_t row_bytes,
                                    struct vff_picture_counts *counts);

// Takes in `count` points (x, y, z) [m] that a camera saw at time `t` [s], in its frame, as far as they are in its picture. `counts` may
// be NULL.
vff_status vff_perceiver_see_points(const struct vff_perceiver *perceiver,
                                    size_t camera,
                                    double t,
                                    const double *points,
                                    size_t count,
                                    struct vff_picture_counts *counts);

// How many points there are, the time of the last picture [s], NaN before the first, and the radius at which balls at the points cover
// what was seen [m]. Each may be NULL.
vff_status vff_perceiver_size(const struct vff_perceiver *perceiver,
                              size_t *count,
                              double *t,
                              double *radius);

// Writes the points at the time of the last picture [m], and with which velocities they go on [m/s]: x, y, z of each, `count` of them as
// `vff_perceiver_size` says. `velocities` may be NULL.
vff_status vff_perceiver_points(const struct vff_perceiver *perceiver,
                                double *points,
                                double *velocities,
                                size_t count);

// Replaces the points of a cloud by those of the last picture, with their velocities. The obstacle stands at the origin, and the
// controller's times are those of the states.
vff_status vff_perceiver_send(const struct vff_perceiver *perceiver,
                              const struct vff_cloud *cloud);

// NULL is nothing.
void vff_perceiver_free(struct vff_perceiver *perceiver);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* VFFNULL_H */
