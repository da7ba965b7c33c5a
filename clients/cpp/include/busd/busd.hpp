// busd in C++17: nodes, publishers, subscriptions and services with lifetimes, over the C client. docs/c.md is the manual.
//
// `bus interface cpp PKG/msg/Type` writes the headers of messages and services.
//
// Objects are moved and not copied. A connection must outlive its nodes and watches, and a node its endpoints. Errors are exceptions
// of type busd::error. One thread at a time uses a connection and everything made with it.
#ifndef BUSD_BUSD_HPP
#define BUSD_BUSD_HPP

#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <busd/busd.h>
#include <busd/types.hpp>

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
    qos &best_available() { return set(value_.durability, std::uint8_t(BUSD_BEST_AVAILABLE)); } // of a subscription
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

namespace detail {
struct closer {
    void operator()(busd_bus *bus) const { busd_close(bus); }
    void operator()(busd_node *node) const { busd_node_destroy(node); }
    void operator()(busd_publisher *publisher) const { busd_publisher_destroy(publisher); }
    void operator()(busd_subscription *subscription) const { busd_subscription_destroy(subscription); }
    void operator()(busd_server *server) const { busd_server_destroy(server); }
    void operator()(busd_client *client) const { busd_client_destroy(client); }
    void operator()(busd_watch *watch) const { busd_watch_destroy(watch); }
    void operator()(const busd_graph *graph) const { busd_graph_free(graph); }
};
template <class T> using owned = std::unique_ptr<T, closer>;

inline int check(const busd_bus *bus, int status)
{
    if (status < 0)
        throw error(-status, busd_error(bus));
    return status;
}

// The same for a function that encodes a struct.
inline int check_encoded(const busd_bus *bus, int status)
{
    if (status == -EINVAL)
        throw error(EINVAL, "a text, bytes or a list is longer than its type permits");
    return check(bus, status);
}

// Memory of decoded lists.
struct arena : busd_arena {
    arena() : busd_arena{} {}
    arena(arena &&other) noexcept : busd_arena(std::exchange(static_cast<busd_arena &>(other), {})) {}
    arena &operator=(arena &&) = delete;
    ~arena() { busd_arena_free(this); }
};
} // namespace detail

// --- messages

// A message that was taken and decoded. Views into it are valid as long as it exists.
template <class T> class taken {
  public:
    explicit taken(const busd_message &raw) : raw_(raw)
    {
        const int status = body_type<T>::decode(&raw_, &value_, &arena_);
        if (status < 0) {
            busd_release(&raw_);
            throw error(-status, "not a message of this type");
        }
    }
    taken(taken &&other) noexcept
        : raw_(std::exchange(other.raw_, {})), arena_(std::move(other.arena_)), value_(other.value_)
    {
    }
    taken(const taken &) = delete;
    taken &operator=(const taken &) = delete;
    taken &operator=(taken &&) = delete;
    ~taken() { busd_release(&raw_); }

    const T &operator*() const { return value_; }
    const T *operator->() const { return &value_; }
    const busd_message &info() const { return raw_; }

  private:
    busd_message raw_{};
    detail::arena arena_;
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
        return status != -EAGAIN && detail::check_encoded(bus_, status) == 0;
    }
    bool wait(int timeout_ms = -1) { return detail::check(bus_, busd_publisher_wait(handle_.get(), timeout_ms)) > 0; }
    // A sign of life, for liveliness manual by topic. A message is one, too.
    void assert_liveliness() { detail::check(bus_, busd_publisher_assert_liveliness(handle_.get())); }
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
        busd_callback *called = state_->call ? &subscription::on_message : nullptr;
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
    // Whether take() would probably find a message.
    bool is_ready() const { return busd_is_ready(handle_.get()); }
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
        callback call;
        std::uint64_t undecodable = 0;
        detail::arena arena;
    };
    static void on_message(void *user, const busd_message *raw) noexcept
    {
        const auto self = static_cast<state *>(user)->shared_from_this(); // the callback may destroy the subscription
        T message;
        busd_arena_clear(&self->arena);
        if (body_type<T>::decode(raw, &message, &self->arena) < 0)
            self->undecodable++;
        else
            self->call(message, *raw);
    }
    busd_bus *bus_;
    std::shared_ptr<state> state_; // stays in place when the subscription moves
    detail::owned<busd_subscription> handle_;
};

// --- services

// How a call ended: with the response, or with the reason why there is none.
template <class Response> class answer {
  public:
    answer(int status, const char *reason, const busd_message *response) : code_(-status)
    {
        if (status < 0) {
            reason_ = reason;
            return;
        }
        const auto bytes = static_cast<const unsigned char *>(response->data);
        bytes_.assign(bytes, bytes + response->size);
        busd_message copy = *response;
        copy.data = bytes_.data();
        code_ = -body_type<Response>::decode(&copy, &value_, &arena_);
        if (code_ != 0)
            reason_ = "not a response of this type";
    }
    explicit operator bool() const { return code_ == 0; }
    int code() const { return code_; } // an errno; 0: the response is there
    const std::string &reason() const { return reason_; }
    // The response; throws the reason. Views into it are valid as long as the answer exists.
    const Response &get() const
    {
        if (code_ != 0)
            throw error(code_, reason_.c_str());
        return value_;
    }
    const Response &operator*() const { return get(); }
    const Response *operator->() const { return &get(); }

  private:
    int code_;
    std::string reason_;
    std::vector<unsigned char> bytes_;
    detail::arena arena_;
    Response value_{};
};

// The answer of a call, later. bus::wait() and bus::dispatch() bring it.
template <class Response> class pending {
  public:
    bool is_ready() const { return place_->has_value(); }
    // The response; throws the reason, or EAGAIN if there is no answer yet. Views into it are valid as long as the
    // pending call exists.
    const Response &get() const
    {
        if (!is_ready())
            throw error(EAGAIN, "the call has no answer yet");
        return (*place_)->get();
    }

  private:
    template <class S> friend class client;
    std::shared_ptr<std::optional<answer<Response>>> place_ = std::make_shared<std::optional<answer<Response>>>();
};

template <class S> class client {
  public:
    using request = typename service_type<S>::request;
    using response = typename service_type<S>::response;
    using callback = std::function<void(answer<response> &&)>;

    client(busd_bus *bus, busd_node *node, const std::string &name, const std::optional<qos> &profile) : bus_(bus)
    {
        busd_client *handle = nullptr;
        detail::check(bus, busd_client_create(node, name.c_str(), service_type<S>::type(),
                                              profile ? profile->get() : nullptr, &handle));
        handle_.reset(handle);
    }
    // `call` gets the answer inside of bus::wait() and bus::dispatch(), or when the client is destroyed. An exception
    // that leaves it ends the program.
    void call(const request &message, callback call)
    {
        auto kept = std::make_unique<callback>(std::move(call));
        detail::check_encoded(bus_, service_type<S>::call(handle_.get(), &message, &client::on_answer, kept.get()));
        kept.release(); // on_answer() frees it
    }
    pending<response> call(const request &message)
    {
        pending<response> result;
        call(message, [place = result.place_](answer<response> &&answer) { place->emplace(std::move(answer)); });
        return result;
    }
    int servers() const { return busd_client_servers(handle_.get()); }
    busd_service_stats stats() const
    {
        busd_service_stats stats;
        busd_client_stats(handle_.get(), &stats);
        return stats;
    }
    busd_client *get() const { return handle_.get(); }

  private:
    static void on_answer(void *user, int status, const char *reason, const busd_message *taken) noexcept
    {
        const std::unique_ptr<callback> kept(static_cast<callback *>(user));
        (*kept)(answer<response>(status, reason, taken));
    }
    busd_bus *bus_;
    detail::owned<busd_client> handle_;
};

template <class S> class server {
    struct state;

  public:
    using request = typename service_type<S>::request;
    using response = typename service_type<S>::response;

    // A call that needs its reply: in the callback, or later. Copies name the same call.
    class call {
      public:
        // Throws ENOENT if the call has its reply, and ECANCELED if the server was destroyed.
        void reply(const response &message)
        {
            const auto [keep, server] = find();
            detail::check_encoded(keep->bus, service_type<S>::reply(server, &id_, &message));
        }
        // Ends the call with an error; the client gets the reason.
        void fail(const std::string &reason)
        {
            const auto [keep, server] = find();
            detail::check(keep->bus, busd_reply_error(server, &id_, reason.c_str()));
        }

      private:
        friend class server;
        call(std::weak_ptr<state> state, const busd_call &id) : state_(std::move(state)), id_(id) {}
        std::pair<std::shared_ptr<state>, busd_server *> find() const
        {
            auto found = state_.lock();
            if (!found || !found->handle)
                throw error(ECANCELED, "the server was destroyed");
            const auto handle = found->handle.get();
            return {std::move(found), handle};
        }
        std::weak_ptr<state> state_;
        busd_call id_;
    };

    // Called inside of bus::wait() and bus::dispatch(). An exception that leaves it ends the program. A request that is
    // not understood has its reply already.
    using callback = std::function<void(const request &message, call)>;

    server(busd_bus *bus, busd_node *node, const std::string &name, callback serve, const std::optional<qos> &profile)
        : state_(std::make_shared<state>(bus, std::move(serve)))
    {
        busd_server *handle = nullptr;
        detail::check(bus, busd_server_create(node, name.c_str(), service_type<S>::type(),
                                              profile ? profile->get() : nullptr, &server::on_request, state_.get(), &handle));
        state_->handle.reset(handle);
    }
    server(server &&) noexcept = default;
    server &operator=(server &&other) noexcept
    {
        end();
        state_ = std::move(other.state_);
        return *this;
    }
    ~server() { end(); }
    busd_service_stats stats() const
    {
        busd_service_stats stats;
        busd_server_stats(get(), &stats);
        return stats;
    }
    busd_server *get() const { return state_->handle.get(); }

  private:
    struct state : std::enable_shared_from_this<state> {
        state(busd_bus *bus, callback serve) : bus(bus), serve(std::move(serve)) {}
        busd_bus *bus;
        callback serve;
        detail::arena arena;
        detail::owned<busd_server> handle;
    };
    void end()
    {
        if (state_)
            state_->handle.reset();
    }
    static void on_request(void *user, busd_server *handle, const busd_call *id, const busd_message *raw) noexcept
    {
        const auto self = static_cast<state *>(user)->shared_from_this(); // the callback may destroy the server
        request message;
        busd_arena_clear(&self->arena);
        if (body_type<request>::decode(raw, &message, &self->arena) < 0)
            busd_reply_error(handle, id, "the request is not understood");
        else
            self->serve(message, call(self, *id));
    }
    std::shared_ptr<state> state_; // stays in place when the server moves
};

// --- the graph

// A snapshot of all nodes and endpoints; see busd.h for the parts. Copies share it. Pointers and views into it are valid as
// long as a copy exists, also after the connection.
class graph {
  public:
    explicit graph(const busd_graph *owned) : graph_(owned, detail::closer()) {}

    span<const busd_graph_node *const> nodes() const { return graph_->nodes; }
    span<const busd_graph_endpoint *const> publishers() const { return graph_->publishers; }
    span<const busd_graph_endpoint *const> subscriptions() const { return graph_->subscriptions; }
    span<const busd_graph_endpoint *const> taps() const { return graph_->taps; }
    span<const busd_graph_match *const> matches() const { return graph_->matches; }
    span<const busd_graph_topic> topics() const { return {graph_->topics, graph_->topic_count}; }
    span<const busd_graph_service> services() const { return {graph_->services, graph_->service_count}; }

    // nullptr if no endpoint has that topic or service.
    const busd_graph_topic *topic(const std::string &name) const { return busd_graph_find_topic(get(), name.c_str()); }
    const busd_graph_service *service(const std::string &name) const
    {
        return busd_graph_find_service(get(), name.c_str());
    }
    const busd_graph *get() const { return graph_.get(); }

  private:
    std::shared_ptr<const busd_graph> graph_;
};

// Calls back with the graph now and after changes, inside of bus::wait() and bus::dispatch(), as long as it exists. The
// callback may destroy it. An exception that leaves the callback ends the program.
class watch {
  public:
    using callback = std::function<void(const graph &)>;

    watch(busd_bus *bus, callback call) : state_(std::make_shared<state>(std::move(call)))
    {
        busd_watch *handle = nullptr;
        detail::check(bus, busd_watch_create(bus, &watch::on_change, state_.get(), &handle));
        handle_.reset(handle);
    }

  private:
    struct state : std::enable_shared_from_this<state> {
        explicit state(callback call) : call(std::move(call)) {}
        callback call;
    };
    static void on_change(void *user, const busd_graph *raw) noexcept
    {
        const auto self = static_cast<state *>(user)->shared_from_this(); // the callback may destroy the watch
        self->call(graph(busd_graph_keep(raw)));
    }
    std::shared_ptr<state> state_; // stays in place when the watch moves
    detail::owned<busd_watch> handle_;
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
    // Without a QoS profile, services have the depth 1000.
    template <class S> client<S> create_client(const std::string &name, const std::optional<qos> &profile = {})
    {
        return client<S>(bus_, handle_.get(), name, profile);
    }
    template <class S>
    server<S> create_server(const std::string &name, typename server<S>::callback serve,
                            const std::optional<qos> &profile = {})
    {
        return server<S>(bus_, handle_.get(), name, std::move(serve), profile);
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
    // From now on, creating waits for nothing: BUSD_REFUSED tells what busd refuses.
    void create_at_once(bool is_on = true) { busd_create_at_once(handle_.get(), is_on); }
    node create_node(const std::string &name, const std::string &ns = "/") { return node(handle_.get(), name, ns); }
    // The graph now, with the counters of endpoints if asked. Waits for busd.
    busd::graph graph(bool with_statistics = false)
    {
        const busd_graph *found = nullptr;
        detail::check(handle_.get(), busd_graph_get(handle_.get(), with_statistics, &found));
        return busd::graph(found);
    }
    [[nodiscard]] watch watch_graph(watch::callback call) { return watch(handle_.get(), std::move(call)); }
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
