//! What a configuration must keep to beyond its types.

mod rules;

use rules::{Unique, all_finite, delay, interface_name, listed_interface, not_empty, not_negative, positive};

use super::{Config, Inertia, PublishCan, SensorEntry, SignalName};
use crate::document::Problem;
use crate::document::Step::{Index, Key};

/// Fewest gauges that determine a wrench.
const SENSORS_MIN: usize = 6;
/// Largest identifier of an extended CAN frame.
const EXTENDED_ID_MAX: u32 = 0x1FFF_FFFF;
/// Fastest fixed rate (Hz): beyond it a timer's own jitter is the period.
const RATE_HZ_MAX: f64 = 10_000.0;
/// Largest ROS 2 domain whose ports exist.
const ROS_DOMAIN_MAX: u32 = 232;

type Checked = Result<(), Problem>;

/// The first thing in `config` that cannot be used.
pub(super) fn check(config: &Config) -> Checked {
    robot(config)?;
    bus(config)?;
    joints(config)?;
    sensors(config)?;
    tool(config)?;
    publish(config)?;
    network_outputs(config)?;
    filter(config)
}

fn robot(config: &Config) -> Checked {
    let robot = &config.robot;
    not_empty(&[Key("robot"), Key("urdf")], "[robot] urdf", &robot.urdf.to_string_lossy())?;
    not_empty(&[Key("robot"), Key("base")], "[robot] base", &robot.base)?;
    not_empty(&[Key("robot"), Key("tip")], "[robot] tip", &robot.tip)?;
    all_finite(&[Key("robot"), Key("gravity")], "[robot] gravity", &robot.gravity_m_s2)?;
    if robot.base == robot.tip {
        let text = format!("[robot] base and tip are both \"{}\"; name the two ends of the arm", robot.base);
        return Err(Problem::new(&[Key("robot"), Key("tip")], text));
    }
    Ok(())
}

fn bus(config: &Config) -> Checked {
    let bus = &config.bus;
    not_empty(&[Key("bus"), Key("dbc")], "[bus] dbc", &bus.dbc.to_string_lossy())?;
    let at = [Key("bus"), Key("interfaces")];
    if bus.interfaces.is_empty() {
        return Err(Problem::new(&at, "[bus] interfaces is empty; name at least one, such as [\"can0\"]"));
    }
    for (index, name) in bus.interfaces.iter().enumerate() {
        interface_name(&at, "[bus] interfaces", name)?;
        if bus.interfaces[..index].contains(name) {
            return Err(Problem::new(&at, format!("[bus] interfaces names \"{name}\" twice; name it once")));
        }
    }
    positive(&[Key("bus"), Key("stale_after_s")], "[bus] stale_after_s", bus.stale_after_s)?;
    let at = [Key("bus"), Key("temperature_stale_after_s")];
    positive(&at, "[bus] temperature_stale_after_s", bus.temperature_stale_after_s)
}

fn joints(config: &Config) -> Checked {
    let mut names = Unique::new("joint", "name");
    let mut positions = Unique::new("joint", "position");
    for (index, joint) in config.joints.iter().enumerate() {
        let at = |key| [Key("joint"), Index(index), Key(key)];
        let of = |key: &str| format!("[[joint]] \"{}\": {key}", joint.name);
        not_empty(&at("name"), "[[joint]] name", &joint.name)?;
        names.add(index, &joint.name, &joint.name)?;
        positions.add(index, &joint.position, &joint.name)?;
        if joint.velocity.as_ref() == Some(&joint.position) {
            let text = format!(
                "{} is the same signal as its position; name the one or leave it out",
                of("velocity")
            );
            return Err(Problem::new(&at("velocity"), text));
        }
        listed_interface(config, &at("interface"), &of("interface"), joint.interface.as_deref())?;
        delay(&at("delay_s"), &of("delay_s"), joint.delay_s)?;
    }
    Ok(())
}

fn sensors(config: &Config) -> Checked {
    let count = config.sensors.len();
    let mut names = Unique::new("sensor", "name");
    let mut signals = Unique::new("sensor", "signal");
    for (index, sensor) in config.sensors.iter().enumerate() {
        not_empty(&[Key("sensor"), Index(index), Key("name")], "[[sensor]] name", &sensor.name)?;
        names.add(index, &sensor.name, &sensor.name)?;
        signals.add(index, &sensor.signal, &sensor.name)?;
        one_sensor(config, index, sensor)?;
    }
    if count < SENSORS_MIN {
        let text = format!(
            "{count} [[sensor]] tables: six components of a wrench need at least {SENSORS_MIN} gauges; add the others"
        );
        return Err(Problem::new(&[Key("sensor")], text));
    }
    Ok(())
}

fn one_sensor(config: &Config, index: usize, sensor: &SensorEntry) -> Checked {
    let at = |key| [Key("sensor"), Index(index), Key(key)];
    let of = |key: &str| format!("[[sensor]] \"{}\": {key}", sensor.name);
    not_empty(&at("section"), &of("section"), &sensor.section)?;
    if let Some(axis) = sensor.axis {
        all_finite(&at("axis"), &of("axis"), &axis)?;
        if axis.iter().map(|x| x * x).sum::<f64>().sqrt() < 1e-6 {
            let text =
                format!("{} = {axis:?} has no direction; give one in the child link's frame", of("axis"));
            return Err(Problem::new(&at("axis"), text));
        }
    }
    let others: [(&'static str, &Option<SignalName>); 3] = [
        ("saturated", &sensor.saturated),
        ("sequence", &sensor.sequence),
        ("temperature", &sensor.temperature),
    ];
    for (key, other) in others {
        if other.as_ref() == Some(&sensor.signal) {
            let text =
                format!("{} is the same signal as its reading; name the right one or leave it out", of(key));
            return Err(Problem::new(&at(key), text));
        }
    }
    if let Some(sequence) =
        sensor.sequence.as_ref().filter(|sequence| sequence.message != sensor.signal.message)
    {
        let text = format!(
            "{} = \"{sequence}\" counts another message than the reading's; name a signal of \"{}\"",
            of("sequence"),
            sensor.signal.message
        );
        return Err(Problem::new(&at("sequence"), text));
    }
    listed_interface(config, &at("interface"), &of("interface"), sensor.interface.as_deref())?;
    delay(&at("delay_s"), &of("delay_s"), sensor.delay_s)
}

fn tool(config: &Config) -> Checked {
    let Some(tool) = &config.tool else { return Ok(()) };
    not_negative(&[Key("tool"), Key("mass")], "[tool] mass", tool.mass_kg)?;
    all_finite(&[Key("tool"), Key("com")], "[tool] com", &tool.com_m)?;
    let at = [Key("tool"), Key("inertia")];
    if let Some(inertia) = &tool.inertia {
        if let Some(why) = impossible(inertia) {
            return Err(Problem::new(
                &at,
                format!("[tool] inertia {why}; give it about the centre of mass, in kg m^2"),
            ));
        }
        if tool.mass_kg == 0.0 && inertia.rows_kg_m2 != Inertia::default().rows_kg_m2 {
            return Err(Problem::new(&at, "[tool] has inertia but mass = 0; give its mass in kg"));
        }
    }
    Ok(())
}

/// Why no rigid body can have this inertia: its principal moments are sums of squares of distances.
fn impossible(inertia: &Inertia) -> Option<&'static str> {
    let rows = &inertia.rows_kg_m2;
    if !rows.iter().flatten().all(|x| x.is_finite()) {
        return Some("is not finite");
    }
    let matrix = nalgebra::Matrix3::from_fn(|row, column| rows[row][column]);
    let scale = matrix.amax();
    if (matrix - matrix.transpose()).amax() > 1e-9 * scale {
        return Some("is not symmetric");
    }
    let moments = matrix.symmetric_eigenvalues();
    let (smallest, sum, largest) = (moments.min(), moments.sum(), moments.max());
    if smallest < -1e-9 * scale {
        return Some("has a negative principal moment");
    }
    (largest > (sum - largest) * (1.0 + 1e-6))
        .then_some("has one principal moment above the sum of the other two")
}

fn publish(config: &Config) -> Checked {
    let publish = &config.publish;
    let at = [Key("publish"), Key("rate_hz")];
    positive(&at, "[publish] rate_hz", publish.rate_hz)?;
    if publish.rate_hz > RATE_HZ_MAX {
        let text = format!("[publish] rate_hz = {} is beyond {RATE_HZ_MAX}; lower it", publish.rate_hz);
        return Err(Problem::new(&at, text));
    }
    publish.can.as_ref().map_or(Ok(()), publish_can)
}

fn publish_can(can: &PublishCan) -> Checked {
    let at = |key| [Key("publish"), Key("can"), Key(key)];
    interface_name(&at("interface"), "[publish.can] interface", &can.interface)?;
    positive(&at("force_n_per_bit"), "[publish.can] force_n_per_bit", can.force_n_per_bit)?;
    positive(&at("torque_nm_per_bit"), "[publish.can] torque_nm_per_bit", can.torque_nm_per_bit)?;
    let ids = [("force_id", can.force_id), ("torque_id", can.torque_id), ("quality_id", can.quality_id)];
    for (index, (key, id)) in ids.into_iter().enumerate() {
        if id > EXTENDED_ID_MAX {
            let text = format!(
                "[publish.can] {key} = {id:#x} is no CAN identifier; the largest is {EXTENDED_ID_MAX:#x}"
            );
            return Err(Problem::new(&at(key), text));
        }
        if let Some((other, _)) = ids[..index].iter().find(|(_, other)| *other == id) {
            let text = format!("[publish.can] {key} = {id:#x} is also {other}; give each frame its own");
            return Err(Problem::new(&at(key), text));
        }
    }
    Ok(())
}

fn network_outputs(config: &Config) -> Checked {
    if let Some(rdt) = &config.publish.rdt {
        let at = |key| [Key("publish"), Key("rdt"), Key(key)];
        for (key, counts) in [("counts_per_n", rdt.counts_per_n), ("counts_per_nm", rdt.counts_per_nm)] {
            if counts == 0 {
                let text = format!("[publish.rdt] {key} = 0 leaves nothing to send; 1000000 is usual");
                return Err(Problem::new(&at(key), text));
            }
        }
        if rdt.allow.is_empty() {
            let text =
                "[publish.rdt] allow is empty, so nobody is answered; name a network or remove the table";
            return Err(Problem::new(&at("allow"), text));
        }
        if let Some(metrics) = &config.publish.metrics
            && metrics.bind == rdt.http
        {
            let text = format!(
                "[publish.metrics] bind = \"{}\" is also [publish.rdt] http; use two ports",
                rdt.http
            );
            return Err(Problem::new(&[Key("publish"), Key("metrics"), Key("bind")], text));
        }
    }
    let Some(ros2) = &config.publish.ros2 else { return Ok(()) };
    let at = |key| [Key("publish"), Key("ros2"), Key(key)];
    not_empty(&at("topic"), "[publish.ros2] topic", &ros2.topic)?;
    not_empty(&at("frame_id"), "[publish.ros2] frame_id", ros2.frame_id.as_deref().unwrap_or("tip"))?;
    not_empty(&at("endpoint"), "[publish.ros2] endpoint", ros2.endpoint.as_deref().unwrap_or("default"))?;
    if ros2.domain > ROS_DOMAIN_MAX {
        let text = format!("[publish.ros2] domain = {} is beyond {ROS_DOMAIN_MAX}; lower it", ros2.domain);
        return Err(Problem::new(&at("domain"), text));
    }
    Ok(())
}

fn filter(config: &Config) -> Checked {
    if let Some(cutoff_hz) = config.filter.cutoff_hz {
        positive(&[Key("filter"), Key("cutoff_hz")], "[filter] cutoff_hz", cutoff_hz)?;
    }
    delay(&[Key("filter"), Key("delay_s")], "[filter] delay_s", config.filter.delay_s)
}
