// A robot on flat ground in Gazebo's physics: Ignition Physics 5 with its default engine.
//
//   gazebo-peer ROBOT.urdf DT_S FRICTION mesh ROLLER.stl
//   gazebo-peer ROBOT.urdf DT_S FRICTION capsule RADIUS_M LENGTH_M
//
// The robot is built as Gazebo builds it: SDFormat reads the URDF, the engine takes links and
// joints from that, and shapes that SDFormat leaves to the caller (the rollers' meshes) are
// attached here. LENGTH_M is that of a capsule's cylinder.
//
// On each line `drive W W W W STEPS` (wheel speeds [rad/s]) or `coast STEPS` (motors without
// torque) follows a line `SECONDS X Y Z YAW A A A A`: the processor time that the steps took,
// where base_link is [m, rad], and the wheels' angles [rad].

#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include <ignition/common/Console.hh>
#include <ignition/common/MeshManager.hh>
#include <ignition/math/eigen3/Conversions.hh>
#include <ignition/physics/CapsuleShape.hh>
#include <ignition/physics/ForwardStep.hh>
#include <ignition/physics/FrameSemantics.hh>
#include <ignition/physics/GetEntities.hh>
#include <ignition/physics/Joint.hh>
#include <ignition/physics/RequestEngine.hh>
#include <ignition/physics/mesh/MeshShape.hh>
#include <ignition/physics/sdf/ConstructModel.hh>
#include <ignition/physics/sdf/ConstructWorld.hh>
#include <ignition/plugin/Loader.hh>
#include <sdf/sdf.hh>

namespace physics = ignition::physics;

using Features = physics::FeatureList<
    physics::sdf::ConstructSdfWorld, physics::sdf::ConstructSdfModel, physics::ForwardStep,
    physics::GetEntities, physics::LinkFrameSemantics, physics::GetBasicJointState,
    physics::SetBasicJointState, physics::SetJointVelocityCommandFeature,
    physics::mesh::AttachMeshShapeFeature, physics::AttachCapsuleShapeFeature>;
using World = physics::World3dPtr<Features>;
using Model = physics::Model3dPtr<Features>;
using Link = physics::Link3dPtr<Features>;
using Joint = physics::Joint3dPtr<Features>;

// Debian builds the engine with a profiler that listens on a port of all addresses. It gets none
// here, and its calls do nothing.
extern "C" int _rmt_CreateGlobalInstance(void **profiler) {
    *profiler = nullptr;
    return 0;
}

namespace {

constexpr auto plugin = ENGINES "/libignition-physics-dartsim-plugin.so";
constexpr std::array wheels{"front_left", "front_right", "rear_left", "rear_right"};

World makeWorld(const std::string &friction) {
    ignition::plugin::Loader loader;
    for (const auto &name : loader.LoadLib(plugin)) {
        const auto engine = physics::RequestEngine3d<Features>::From(loader.Instantiate(name));
        if (!engine) continue;
        ::sdf::Root root;
        // the engine takes the lower coefficient of two bodies; the robot's is its default, 1
        const auto errors = root.LoadSdfString(R"(<sdf version="1.9"><world name="flat">
            <gravity>0 0 -9.80665</gravity>
            <model name="ground"><static>true</static><link name="ground">
              <collision name="ground"><geometry><plane/></geometry>
                <surface><friction><ode><mu>)" + friction + "</mu><mu2>" + friction + R"(</mu2>
                </ode></friction></surface></collision>
            </link></model></world></sdf>)");
        if (!errors.empty()) throw std::runtime_error(errors.front().Message());
        return engine->ConstructWorld(*root.WorldByIndex(0));
    }
    throw std::runtime_error(std::string("no engine with the features in ") + plugin);
}

void attach(const Link &link, const ::sdf::Collision &collision, char **shape) {
    const auto pose = ignition::math::eigen3::convert(collision.RawPose());
    if (shape[0] == std::string("capsule")) {
        const double radius = std::atof(shape[1]), length = std::atof(shape[2]);
        link->AttachCapsuleShape(collision.Name(), radius, length, pose);
        return;
    }
    const auto *mesh = ignition::common::MeshManager::Instance()->Load(shape[1]);
    if (mesh == nullptr) throw std::runtime_error(std::string("no mesh: ") + shape[1]);
    link->AttachMeshShape(collision.Name(), *mesh, pose);
}

Model makeRobot(const World &world, const char *urdf, char **shape) {
    ::sdf::Root root;
    const auto errors = root.Load(urdf);
    if (!errors.empty()) throw std::runtime_error(errors.front().Message());
    const auto *description = root.Model();
    ignition::common::Console::SetVerbosity(0);  // it complains of each mesh: see below
    const Model robot = world->ConstructModel(*description);
    ignition::common::Console::SetVerbosity(1);
    for (std::uint64_t i = 0; i < description->LinkCount(); ++i) {
        const auto *link = description->LinkByIndex(i);
        for (std::uint64_t j = 0; j < link->CollisionCount(); ++j) {
            const auto *collision = link->CollisionByIndex(j);
            if (collision->Geom()->Type() == ::sdf::GeometryType::MESH)
                attach(robot->GetLink(link->Name()), *collision, shape);
        }
    }
    return robot;
}

double processorTime() {
    std::timespec time;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void serve(const World &world, const Model &robot, double dt) {
    const Link base = robot->GetLink("base_link");
    std::array<Joint, wheels.size()> joints;
    for (std::size_t i = 0; i < wheels.size(); ++i)
        joints[i] = robot->GetJoint(std::string(wheels[i]) + "_wheel_joint");
    physics::ForwardStep::Input input;
    physics::ForwardStep::State state;
    physics::ForwardStep::Output output;
    input.Get<std::chrono::steady_clock::duration>() =
        std::chrono::duration_cast<std::chrono::steady_clock::duration>(
            std::chrono::duration<double>(dt));

    std::cout << std::setprecision(17);
    for (std::string line; std::getline(std::cin, line);) {
        std::istringstream words(line);
        std::string what;
        std::array<double, wheels.size()> speeds{};
        int steps = 0;
        words >> what;
        const bool driven = what == "drive";
        if (driven)
            for (auto &speed : speeds) words >> speed;
        if (!(words >> steps)) throw std::runtime_error("not understood: " + line);

        const double begin = processorTime();
        for (int step = 0; step < steps; ++step) {
            // as Gazebo does: the engine forgets a command with each step
            for (std::size_t i = 0; i < joints.size(); ++i) {
                if (driven)
                    joints[i]->SetVelocityCommand(0, speeds[i]);
                else
                    joints[i]->SetForce(0, 0.0);
            }
            world->Step(output, state, input);
        }
        const auto pose = base->FrameDataRelativeToWorld().pose;
        const double spent = processorTime() - begin;

        const auto place = pose.translation();
        const auto turn = pose.linear();
        std::cout << spent << ' ' << place.x() << ' ' << place.y() << ' ' << place.z() << ' '
                  << std::atan2(turn(1, 0), turn(0, 0));
        for (const auto &joint : joints) std::cout << ' ' << joint->GetPosition(0);
        std::cout << std::endl;
    }
}

}  // namespace

int main(int count, char **arguments) {
    try {
        if (count < 6) throw std::runtime_error("usage: see the head of gazebo_peer.cpp");
        const World world = makeWorld(arguments[3]);
        const Model robot = makeRobot(world, arguments[1], arguments + 4);
        serve(world, robot, std::atof(arguments[2]));
    } catch (const std::exception &error) {
        std::cerr << "gazebo-peer: " << error.what() << '\n';
        return 1;
    }
}
