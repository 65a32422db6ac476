//! Where ROS 2 looks over zenoh: keys of topics, tokens of the graph, attachments. (rmw_zenoh, docs/design.md)

use ros::Message;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::config::Config;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

/// Name of the node.
const NODE: &str = "wrenchd";
/// The graph's tokens are under this.
const ADMIN_SPACE: &str = "@ros2_lv";
/// What stands for a slash, and for nothing.
const SLASH: &str = "%";
/// Defaults, and the last ten kept: reliable, volatile.
const QOS: &str = "::,10:,:,:,,";
/// Where rmw_zenoh's router is unless told.
const ROUTER: &str = "tcp/localhost:7447";
const GID_BYTES: usize = 16;
/// How long a message waits for a subscriber that is slow before it is dropped, us: a machine that stands still for a moment loses none, and none
/// gets old. (zenoh's own default, a thousandth of a second, lost some on a busy machine.)
const PATIENCE_US: &str = "100000";

/// A node in the graph of one domain.
pub(crate) struct Node {
    session: zenoh::Session,
    domain: u32,
    type_hashes: bool,
    entities: u32,
    /// The graph shows what has a token as long as it has it.
    tokens: Vec<LivelinessToken>,
}

/// One topic of the node.
pub(crate) struct Topic {
    publisher: Publisher<'static>,
    gid: [u8; GID_BYTES],
    sequence: i64,
}

/// The session as rmw_zenoh has it: a peer that goes to the router and learns of others from it; without one it tries on.
fn configuration(endpoint: Option<&str>) -> zenoh::Result<Config> {
    let mut config = Config::default();
    let endpoint = serde_json::to_string(&[endpoint.unwrap_or(ROUTER)])?;
    for (key, value) in [
        ("mode", "\"peer\""),
        ("connect/endpoints", endpoint.as_str()),
        ("connect/timeout_ms", "-1"),
        ("connect/exit_on_failure", "false"),
        // By number: a small system may know no name, not even this one.
        ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]"),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "true"),
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", PATIENCE_US),
    ] {
        config.insert_json5(key, value)?;
    }
    Ok(config)
}

impl Node {
    /// Joins the graph.
    pub(crate) fn join(endpoint: Option<&str>, domain: u32, type_hashes: bool) -> zenoh::Result<Self> {
        let session = zenoh::open(configuration(endpoint)?).wait()?;
        let mut node = Self { session, domain, type_hashes, entities: 0, tokens: Vec::new() };
        let token = format!("{}/{SLASH}/{SLASH}/{NODE}", node.entity("NN"));
        node.declare(token)?;
        Ok(node)
    }

    /// Announces a topic and publishes on it from then on.
    pub(crate) fn topic<M: Message>(&mut self, name: &str) -> zenoh::Result<Topic> {
        let name = name.trim_matches('/');
        let hash = if self.type_hashes { M::TYPE_HASH } else { "TypeHashNotSupported" };
        let (kind, mangled) = (M::dds_name(), format!("/{name}").replace('/', SLASH));
        let token = format!("{}/{SLASH}/{SLASH}/{NODE}/{mangled}/{kind}/{hash}/{QOS}", self.entity("MP"));
        let gid = gid(&token);
        self.declare(token)?;
        let key = format!("{}/{name}/{kind}/{hash}", self.domain);
        // Who is too slow misses some: the next wrench is better than an old one.
        let publisher = self
            .session
            .declare_publisher(key)
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .wait()?;
        Ok(Topic { publisher, gid, sequence: 0 })
    }

    /// The first part of a new entity's token.
    fn entity(&mut self, kind: &str) -> String {
        let id = self.entities;
        self.entities += 1;
        format!("{ADMIN_SPACE}/{}/{}/0/{id}/{kind}", self.domain, self.session.zid())
    }

    fn declare(&mut self, token: String) -> zenoh::Result<()> {
        self.tokens.push(self.session.liveliness().declare_token(token).wait()?);
        Ok(())
    }
}

impl Topic {
    /// Publishes a message with its attachment: number, time (ns since the Unix epoch), the publisher's identity.
    pub(crate) fn publish(&mut self, message: &impl Message, now_ns: i64) -> zenoh::Result<()> {
        self.sequence += 1;
        let mut attachment = [0; 17 + GID_BYTES];
        attachment[..8].copy_from_slice(&self.sequence.to_le_bytes());
        attachment[8..16].copy_from_slice(&now_ns.to_le_bytes());
        attachment[16] = GID_BYTES as u8;
        attachment[17..].copy_from_slice(&self.gid);
        self.publisher.put(message.cdr()).attachment(ZBytes::from(attachment.to_vec())).wait()
    }
}

/// Sixteen bytes that are another publisher's by chance only: FNV-1a of its token, from two starts.
fn gid(token: &str) -> [u8; GID_BYTES] {
    let hash = |start: u64| {
        token.bytes().fold(start, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    };
    let mut gid = [0; GID_BYTES];
    gid[..8].copy_from_slice(&hash(0xcbf2_9ce4_8422_2325).to_le_bytes());
    gid[8..].copy_from_slice(&hash(0x9e37_79b9_7f4a_7c15).to_le_bytes());
    gid
}
