// The C++ side of tests/system/test_c_client.py: publishes poses on /cpp/out for each text on /cpp/in, and takes its own
// poses again.
#include <csignal>
#include <cstdio>

#include <busd/busd.hpp>

#include "geometry_msgs/msg/PoseArray.hpp"
#include "std_msgs/msg/String.hpp"

static volatile std::sig_atomic_t has_ended = 0;

int main()
{
    std::signal(SIGTERM, [](int) { has_ended = 1; });
    try {
        busd::bus bus("peer.cpp");
        bus.on_event([](const busd_event &event) { std::printf("event %d: %s\n", int(event.kind), event.text); });
        busd::node node = bus.create_node("cpp_peer");
        auto out = node.create_publisher<geometry_msgs::msg::PoseArray>("/cpp/out", busd::qos().keep_all());
        auto again = node.create_subscription<geometry_msgs::msg::PoseArray>("/cpp/out", busd::qos().keep_all());
        auto in = node.create_subscription<std_msgs::msg::String>(
            "/cpp/in", busd::qos().keep_all(), [&](const std_msgs::msg::String &text, const busd_message &) {
                std::vector<geometry_msgs::msg::Pose> poses(3);
                for (int i = 0; i < 3; i++)
                    poses[i].position.x = i;
                geometry_msgs::msg::PoseArray message;
                message.header.frame_id = text.data;
                message.poses = poses;
                if (!out.publish(message))
                    std::printf("no room\n");
            });
        std::optional<busd::subscription<geometry_msgs::msg::PoseArray>> once;
        const std::string said = "destroyed in its callback";
        once.emplace(node.create_subscription<geometry_msgs::msg::PoseArray>(
            "/cpp/out", busd::qos(), [&once, said](const geometry_msgs::msg::PoseArray &, const busd_message &) {
                once.reset();
                std::printf("%s\n", said.c_str());
            }));
        try {
            node.create_publisher<std_msgs::msg::String>("/a b");
        } catch (const busd::error &error) {
            std::printf("refused %d: %s\n", error.code().value(), error.what());
        }
        auto sign = node.create_publisher<std_msgs::msg::String>("/cpp/sign", busd::qos().manual_by_topic());
        sign.assert_liveliness();
        std::printf("ready\n");
        std::fflush(stdout);
        while (!has_ended) {
            bus.wait();
            while (auto got = again.is_ready() ? again.take() : std::nullopt) {
                auto moved = std::move(*got);
                const std::string frame(moved->header.frame_id);
                std::printf("%s %zu poses, x %g, w %g\n", frame.c_str(), moved->poses.size(), moved->poses[2].position.x,
                            moved->poses[2].orientation.w);
            }
            std::fflush(stdout);
        }
        std::printf("taken %llu, published %llu\n", static_cast<unsigned long long>(again.stats().samples),
                    static_cast<unsigned long long>(out.stats().samples));
    } catch (const busd::error &error) {
        std::printf("failed: %s\n", error.what());
        return 1;
    }
}
