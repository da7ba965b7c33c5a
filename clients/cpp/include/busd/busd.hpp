// busd in C++17: nodes, publishers and subscriptions with lifetimes, over the C client. docs/c.md is the manual.
//
// Objects are moved and not copied. A connection must outlive its nodes, and a node its endpoints. Errors are exceptions
// of type busd::error. One thread at a time uses a connection and everything made with it.
#ifndef BUSD_BUSD_HPP
#define BUSD_BUSD_HPP

#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <busd/busd.h>
#include <busd/types.h>

namespace busd {

// An errno, and the reason in words.
class error : public std::system_error {
  public:
    error(int code, const char *text) : std::system_error(code, std::generic_category(), text) {}
};

// --- QoS: busd::qos().depth(5).best_effort()

class qos {
  public:
    qos() { value_.depth = 10; }
    qos &depth(std::uint32_t depth) { return set(value_.depth, depth); }
    qos &keep_all() { return set(value_.history, std::uint8_t(BUSD_KEEP_ALL)); }
    qos &best_effort() { return set(value_.reliability, std::uint8_t(BUSD_BEST_EFFORT)); }
    qos &transient_local() { return set(value_.durability, std::uint8_t(BUSD_TRANSIENT_LOCAL)); }
    qos &manual_by_topic() { return set(value_.liveliness, std::uint8_t(BUSD_MANUAL_BY_TOPIC)); }
    qos &lifespan_ns(std::int64_t ns) { return set(value_.lifespan_ns, ns); }
    qos &deadline_ns(std::int64_t ns) { return set(value_.deadline_ns, ns); }
    qos &lease_ns(std::int64_t ns) { return set(value_.lease_ns, ns); }
    const busd_qos *get() const { return &value_; }

  private:
    template <class T> qos &set(T &member, T value)
    {
        member = value;
        return *this;
    }
    busd_qos value_{};
};

// --- views of texts and lists

inline busd_text text(std::string_view view) { return {view.data(), view.size()}; }
inline std::string_view view(const busd_text &text) { return {text.data, text.size}; }

namespace detail {
struct closer {
    void operator()(busd_bus *bus) const { busd_close(bus); }
    void operator()(busd_node *node) const { busd_node_destroy(node); }
    void operator()(busd_publisher *publisher) const { busd_publisher_destroy(publisher); }
    void operator()(busd_subscription *subscription) const { busd_subscription_destroy(subscription); }
};
template <class T> using owned = std::unique_ptr<T, closer>;

inline int check(const busd_bus *bus, int status)
{
    if (status < 0)
        throw error(-status, busd_error(bus));
    return status;
}
} // namespace detail

// --- messages

// A message that was taken and decoded. Views into it are valid as long as it exists.
template <class T> class taken {
  public:
    explicit taken(const busd_message &raw) : raw_(raw)
    {
        const int status = message_type<T>::decode(&raw_, &value_, &arena_);
        if (status < 0) {
            release();
            throw error(-status, "not a message of this type");
        }
    }
    taken(taken &&other) noexcept
        : raw_(std::exchange(other.raw_, {})), arena_(std::exchange(other.arena_, {})), value_(other.value_)
    {
    }
    taken(const taken &) = delete;
    taken &operator=(const taken &) = delete;
    taken &operator=(taken &&) = delete;
    ~taken() { release(); }

    const T &operator*() const { return value_; }
    const T *operator->() const { return &value_; }
    const busd_message &info() const { return raw_; }

  private:
    void release()
    {
        busd_arena_free(&arena_);
        busd_release(&raw_);
    }
    busd_message raw_{};
    busd_arena arena_{};
    T value_{};
};

// --- endpoints

template <class T> class publisher {
  public:
    publisher(busd_bus *bus, busd_node *node, const std::string &topic, const qos &profile) : bus_(bus)
    {
        busd_publisher *handle = nullptr;
        detail::check(bus, busd_publisher_create(node, topic.c_str(), message_type<T>::type(), profile.get(), &handle));
        handle_.reset(handle);
    }
    // False: a lossless publisher has no room; see wait().
    bool publish(const T &message)
    {
        const int status = message_type<T>::publish(handle_.get(), &message);
        if (status == -EINVAL)
            throw error(EINVAL, "a text, bytes or a list is longer than its type permits");
        return status != -EAGAIN && detail::check(bus_, status) == 0;
    }
    bool wait(int timeout_ms = -1) { return detail::check(bus_, busd_publisher_wait(handle_.get(), timeout_ms)) > 0; }
    int matches() const { return busd_publisher_matches(handle_.get()); }
    busd_stats stats() const
    {
        busd_stats stats;
        busd_publisher_stats(handle_.get(), &stats);
        return stats;
    }
    busd_publisher *get() const { return handle_.get(); }

  private:
    busd_bus *bus_;
    detail::owned<busd_publisher> handle_;
};

template <class T> class subscription {
  public:
    // With a callback, messages come inside of bus::wait() and bus::dispatch(). Without one, take() takes them. An
    // exception that leaves a callback ends the program.
    using callback = std::function<void(const T &message, const busd_message &info)>;

    subscription(busd_bus *bus, busd_node *node, const std::string &topic, const qos &profile, callback call = nullptr)
        : bus_(bus), state_(std::make_shared<state>(std::move(call)))
    {
        busd_subscription *handle = nullptr;
        busd_callback *called = state_->call ? &subscription::hear : nullptr;
        detail::check(bus, busd_subscription_create(node, topic.c_str(), message_type<T>::type(), profile.get(), called,
                                                    state_.get(), &handle));
        handle_.reset(handle);
    }
    std::optional<taken<T>> take()
    {
        busd_message raw;
        if (detail::check(bus_, busd_take(handle_.get(), &raw)) == 0)
            return std::nullopt;
        return std::optional<taken<T>>(std::in_place, raw);
    }
    int matches() const { return busd_subscription_matches(handle_.get()); }
    std::uint64_t undecodable() const { return state_->undecodable; }
    busd_stats stats() const
    {
        busd_stats stats;
        busd_subscription_stats(handle_.get(), &stats);
        return stats;
    }
    busd_subscription *get() const { return handle_.get(); }

  private:
    struct state : std::enable_shared_from_this<state> {
        explicit state(callback call) : call(std::move(call)) {}
        state(const state &) = delete;
        state &operator=(const state &) = delete;
        ~state() { busd_arena_free(&arena); }
        callback call;
        std::uint64_t undecodable = 0;
        busd_arena arena{};
    };
    static void hear(void *user, const busd_message *raw) noexcept
    {
        const auto self = static_cast<state *>(user)->shared_from_this(); // the callback may destroy the subscription
        T message;
        busd_arena_clear(&self->arena);
        if (message_type<T>::decode(raw, &message, &self->arena) < 0)
            self->undecodable++;
        else
            self->call(message, *raw);
    }
    busd_bus *bus_;
    std::shared_ptr<state> state_; // stays in place when the subscription moves
    detail::owned<busd_subscription> handle_;
};

// --- nodes and the connection

class node {
  public:
    node(busd_bus *bus, const std::string &name, const std::string &ns) : bus_(bus)
    {
        busd_node *handle = nullptr;
        detail::check(bus, busd_node_create(bus, name.c_str(), ns.c_str(), &handle));
        handle_.reset(handle);
    }
    template <class T> publisher<T> create_publisher(const std::string &topic, const qos &profile = qos())
    {
        return publisher<T>(bus_, handle_.get(), topic, profile);
    }
    template <class T>
    subscription<T> create_subscription(const std::string &topic, const qos &profile = qos(),
                                        typename subscription<T>::callback call = nullptr)
    {
        return subscription<T>(bus_, handle_.get(), topic, profile, std::move(call));
    }
    busd_node *get() const { return handle_.get(); }

  private:
    busd_bus *bus_;
    detail::owned<busd_node> handle_;
};

class bus {
  public:
    explicit bus(const std::string &program, const char *path = nullptr)
    {
        busd_bus *handle = nullptr;
        const int status = busd_connect(&handle, path, program.c_str());
        handle_.reset(handle);
        detail::check(handle, status);
    }
    node create_node(const std::string &name, const std::string &ns = "/") { return node(handle_.get(), name, ns); }
    int fd() const { return busd_fd(handle_.get()); }
    bool dispatch() { return detail::check(handle_.get(), busd_dispatch(handle_.get())) > 0; }
    bool wait(int timeout_ms = -1) { return detail::check(handle_.get(), busd_wait(handle_.get(), timeout_ms)) > 0; }
    bool is_connected() const { return busd_is_connected(handle_.get()) != 0; }
    void on_event(std::function<void(const busd_event &)> call)
    {
        auto kept = std::make_shared<events>(std::move(call));
        busd_on_event(handle_.get(), &bus::report, kept.get());
        call_ = std::move(kept);
    }
    busd_bus *get() const { return handle_.get(); }

  private:
    struct events : std::enable_shared_from_this<events> {
        explicit events(std::function<void(const busd_event &)> call) : call(std::move(call)) {}
        std::function<void(const busd_event &)> call;
    };
    static void report(void *user, const busd_event *event) noexcept
    {
        const auto self = static_cast<events *>(user)->shared_from_this(); // the callback may be replaced in itself
        if (self->call)
            self->call(*event);
    }
    std::shared_ptr<events> call_; // outlives the connection
    detail::owned<busd_bus> handle_;
};

} // namespace busd

#endif
