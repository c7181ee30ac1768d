// A ball is swept through the elbow of a Panda that holds its hand still. MuJoCo is the robot, in one thread at 1 kHz; vffnull
// drives it from another, as a program for a real arm would.
//
//     sweep [--seconds 10] [--points]           against the clock: latency, jitter, clearance
//     sweep --lockstep FILE [--cycles 3000]     one after the other in one thread; FILE gets t and q of every cycle
//
// With `--points` the ball is a cloud of points, as of a depth camera, that a third thread sends 50 times a second.

#include <pthread.h>
#include <semaphore.h>
#include <sys/mman.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <mujoco/mujoco.h>
#include <vffnull.hpp>

namespace {

constexpr std::size_t joints = 7;
constexpr double period = 0.001;  // s
constexpr double radius = 0.08;   // m, of the ball
constexpr std::array<double, joints> start{0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854};

using Joints = std::array<double, joints>;
using Point = std::array<double, 3>;

/// The ball, to and fro through the place of the elbow, once in 10 s.
struct Ball {
    Point position, velocity;

    static Ball at(double t) {
        const double rate = 2.0 * 3.14159265358979323846 / 10.0;
        return {{-0.05, -0.6 * std::cos(rate * t), 0.62}, {0.0, 0.6 * rate * std::sin(rate * t), 0.0}};
    }
};

struct State {
    long cycle = 0;
    long published = 0;  // ns
    double t = 0.0;      // s
    Joints q{}, dq{};
};

struct Command {
    long cycle = -1;
    Joints tau{};
};

/// The latest value of one thread for one other, without a lock: three places, one of which lies between the two.
template <class T>
class Latest {
public:
    T& next() noexcept { return places_[write_]; }
    void publish() noexcept { write_ = middle_.exchange(write_ | fresh, std::memory_order_acq_rel) & place; }
    const T& read() noexcept {
        if (middle_.load(std::memory_order_relaxed) & fresh) {
            read_ = middle_.exchange(read_, std::memory_order_acq_rel) & place;
        }
        return places_[read_];
    }

private:
    static constexpr unsigned fresh = 4, place = 3;
    std::array<T, 3> places_{};
    std::atomic<unsigned> middle_{2};
    unsigned write_ = 0, read_ = 1;
};

long now() {
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * 1'000'000'000L + time.tv_nsec;
}

/// The arm in MuJoCo, and the ball as a body that is moved by hand.
class Plant {
public:
    explicit Plant(const std::string& file) {
        std::array<char, 1000> error{};
        model_.reset(mj_loadXML(file.c_str(), nullptr, error.data(), static_cast<int>(error.size())));
        if (!model_) {
            throw std::runtime_error(error.data());
        }
        model_->opt.timestep = period;
        data_.reset(mj_makeData(model_.get()));
        ball_ = mj_name2id(model_.get(), mjOBJ_GEOM, "obstacle_1");
        if (model_->nq != static_cast<int>(joints) || ball_ < 0 || model_->nsite != 1) {
            throw std::runtime_error(file + ": expected seven joints, a ball, and a site at the tip");
        }
        std::copy(start.begin(), start.end(), data_->qpos);
        set_ball(Ball::at(0.0));
        mj_forward(model_.get(), data_.get());
        std::copy_n(data_->site_xpos, 3, tip_.begin());
    }

    void read(Joints& q, Joints& dq) const {
        std::copy_n(data_->qpos, joints, q.begin());
        std::copy_n(data_->qvel, joints, dq.begin());
    }

    double time() const { return data_->time; }

    /// One period under a torque, which the motors limit.
    void step(const Joints& tau, const Ball& ball) {
        std::copy(tau.begin(), tau.end(), data_->ctrl);
        set_ball(ball);
        mj_step(model_.get(), data_.get());
    }

    /// The distance of the ball from the nearest link that moves, by MuJoCo's own reckoning [m].
    double clearance() {
        double least = std::numeric_limits<double>::infinity();
        for (int geom = 0; geom < model_->ngeom; ++geom) {
            if (model_->geom_contype[geom] != 0) {  // those of the links; the base and the ball have 0
                least = std::min(least, mj_geomDistance(model_.get(), data_.get(), geom, ball_, 2.0, nullptr));
            }
        }
        return least;
    }

    /// How far the tip is from where it was at the start [m].
    double drift() const {
        const double* tip = data_->site_xpos;
        return std::hypot(tip[0] - tip_[0], tip[1] - tip_[1], tip[2] - tip_[2]);
    }

private:
    void set_ball(const Ball& ball) { std::copy(ball.position.begin(), ball.position.end(), data_->mocap_pos); }

    struct Free {
        void operator()(mjModel* model) const { mj_deleteModel(model); }
        void operator()(mjData* data) const { mj_deleteData(data); }
    };
    std::unique_ptr<mjModel, Free> model_;
    std::unique_ptr<mjData, Free> data_;
    int ball_ = -1;
    Point tip_{};
};

[[noreturn]] void fail(const char* what, vff::Status status) {
    throw std::runtime_error(std::string(what) + ": " + status.name() + ": " + vff::message());
}

/// One cycle of the controller: what a camera saw of the ball, what the encoders say, the torque.
vff::Status cycle(vff::Controller& controller, std::uint32_t id, const State& state, Joints& tau) noexcept {
    const Ball ball = Ball::at(state.t);
    vff::Status status = controller.move_obstacle(id, state.t, ball.position, ball.velocity);
    if (status) status = controller.observe(state.t, state.q, state.dq);
    if (status) status = controller.torque(tau);
    return status;
}

int lockstep(vff::Controller& controller, Plant& plant, const std::string& file, long cycles) {
    std::ofstream out(file);
    out.precision(17);
    State state;
    Joints tau{};
    for (long k = 0; k < cycles; ++k) {
        state.t = period * static_cast<double>(k);
        plant.read(state.q, state.dq);
        if (const auto status = cycle(controller, 0, state, tau); !status) fail("torque", status);
        out << state.t;
        for (double each : state.q) out << ' ' << each;
        out << '\n';
        plant.step(tau, Ball::at(state.t));
    }
    return out.good() ? 0 : 1;
}

/// Takes a thread out of the way of others, as far as the system allows.
bool urgent(int priority) {
    sched_param wanted{};
    wanted.sched_priority = priority;
    return pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
}

void report(const char* name, std::vector<long>& times) {
    if (times.empty()) return;
    std::sort(times.begin(), times.end());
    const auto at = [&](double share) {
        const auto last = static_cast<double>(times.size() - 1);
        return 1e-3 * static_cast<double>(times[static_cast<std::size_t>(share * last)]);
    };
    std::printf("%-28s p50 %8.1f µs   p99 %8.1f µs   p99.9 %8.1f µs   max %8.1f µs\n", name, at(0.5), at(0.99), at(0.999), at(1.0));
}

/// Points on the ball, about its centre.
std::vector<double> surface(std::size_t count, double turn) {
    std::vector<double> points;
    points.reserve(3 * count);
    for (std::size_t i = 0; i < count; ++i) {
        const double z = 1.0 - (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(count);
        const double angle = turn + 2.399963229728653 * static_cast<double>(i), across = std::sqrt(1.0 - z * z);
        for (double x : {across * std::cos(angle), across * std::sin(angle), z}) {
            points.push_back((radius - 0.005) * x);  // every point is a ball of 5 mm
        }
    }
    return points;
}

int against_the_clock(vff::Controller& controller, std::uint32_t id, vff::Cloud* cloud, Plant& plant, double seconds) {
    const auto cycles = std::max(1L, static_cast<long>(seconds / period));
    Latest<State> states;
    Latest<Command> commands;
    sem_t wake;
    sem_init(&wake, 0, 0);
    std::atomic<bool> over{false}, started{false};
    std::atomic<int> fault{VFF_STATUS_OK};
    std::string sentence;
    std::vector<long> latency, compute, lateness;
    for (auto* times : {&latency, &compute, &lateness}) times->reserve(static_cast<std::size_t>(cycles));
    const bool locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    bool is_urgent = false;

    std::thread controlling([&] {
        is_urgent = urgent(80);
        started.store(true);
        while (true) {
            while (sem_wait(&wake) != 0) {
            }
            if (over.load()) return;
            const State& state = states.read();
            Command& command = commands.next();
            if (command.cycle == state.cycle) continue;
            const long begun = now();
            const vff::Status status = cycle(controller, id, state, command.tau);
            command.cycle = state.cycle;
            const long ended = now();
            if (!status) {
                sentence = vff::message();
                fault.store(status.code());
                return;
            }
            commands.publish();
            if (compute.size() < compute.capacity()) {
                compute.push_back(ended - begun);
                latency.push_back(ended - state.published);
            }
        }
    });
    std::thread seeing([&] {
        for (double turn = 0.0; cloud && !over.load(); turn += 0.1) {
            cloud->update(surface(400, turn));
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
    });

    // The robot: once per period it takes the torque for its state. Where that has not come yet, its time stands still.
    while (!started.load()) std::this_thread::yield();
    const bool robot_urgent = urgent(90);
    double clearance = std::numeric_limits<double>::infinity(), drift = 0.0;
    long late = 0, next = now(), number = 0;
    bool stepped = true;
    for (long k = 0; k < cycles && fault.load() == VFF_STATUS_OK; ++k) {
        if (stepped) {
            State& state = states.next();
            state.cycle = number;
            state.t = plant.time();
            plant.read(state.q, state.dq);
            state.published = now();
            states.publish();
            sem_post(&wake);
        }
        next += static_cast<long>(1e9 * period);
        const timespec until{next / 1'000'000'000L, next % 1'000'000'000L};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
        }
        lateness.push_back(now() - next);
        const Command& command = commands.read();
        stepped = command.cycle == number;
        if (!stepped) {
            ++late;
            continue;
        }
        plant.step(command.tau, Ball::at(plant.time()));
        drift = std::max(drift, plant.drift());
        if (number++ % 10 == 0) clearance = std::min(clearance, plant.clearance());
    }
    over.store(true);
    sem_post(&wake);
    controlling.join();
    seeing.join();
    sem_destroy(&wake);
    if (fault.load() != VFF_STATUS_OK) throw std::runtime_error(sentence);

    std::printf("%zu cycles of %g s; memory %s, threads %s\n", lateness.size(), period, locked ? "locked" : "not locked (mlockall)",
                is_urgent && robot_urgent ? "SCHED_FIFO" : "without priority (SCHED_FIFO)");
    report("jitter, robot wakes late by", lateness);
    report("latency, state to torque", latency);
    report("compute, observe + torque", compute);
    std::printf("%-28s %ld of %zu\n", "torques that came too late", late, lateness.size());
    std::printf("%-28s %.4f m, by MuJoCo's measure; the hand drifted by at most %.2g m\n", "least clearance", clearance, drift);
    return clearance > 0.0 ? 0 : 1;
}

}  // namespace

int main(int count, char** arguments) try {
    double seconds = 10.0;
    long cycles = 3000;
    std::string file, model = MODEL, scenario = SCENARIO;
    bool points = false;
    for (int i = 1; i < count; ++i) {
        const std::string option = arguments[i];
        if (option == "--points") {
            points = true;
            continue;
        }
        if (++i == count) throw std::runtime_error(option + ": its value is missing");
        const std::string value = arguments[i];
        if (option == "--seconds") seconds = std::stod(value);
        else if (option == "--cycles") cycles = std::stol(value);
        else if (option == "--lockstep") file = value;
        else if (option == "--model") model = value;
        else if (option == "--scenario") scenario = value;
        else throw std::runtime_error(option + ": there is no such option");
    }
    Plant plant(model);
    auto controller = vff::Controller::from_scenario_file(scenario);
    controller.check_period(period);
    if (!file.empty()) return lockstep(controller, plant, file, cycles);
    if (!points) return against_the_clock(controller, 0, nullptr, plant, seconds);
    controller.remove_obstacle(0);
    const auto id = controller.add_obstacle("shape = { kind = 'points', points = [], radius = 0.005 }");
    auto cloud = controller.cloud(id, 400);
    cloud.update(surface(400, 0.0));
    return against_the_clock(controller, id, &cloud, plant, seconds);
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
