//! Values of a configuration that are more than a number or a string.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr};

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

/// A signal of the DBC, written `"Message.Signal"`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Deserialize)]
#[serde(try_from = "String")]
pub struct SignalName {
    /// Name of the message in the DBC.
    pub message: String,
    /// Name of the signal inside the message.
    pub signal: String,
}

impl TryFrom<String> for SignalName {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        match text.split_once('.') {
            Some((message, signal)) if !message.is_empty() && !signal.is_empty() && !signal.contains('.') => {
                Ok(Self { message: message.to_owned(), signal: signal.to_owned() })
            }
            _ => Err(format!(
                "\"{text}\" does not name a signal; write \"Message.Signal\" with the names of the DBC"
            )),
        }
    }
}

impl fmt::Display for SignalName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.message, self.signal)
    }
}

/// A range of network addresses, written `"127.0.0.0/8"` or as a single address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Network {
    address: IpAddr,
    prefix_bits: u8,
}

impl Network {
    /// IPv4 loopback, 127.0.0.0/8.
    pub const LOOPBACK: Self = Self { address: IpAddr::V4(Ipv4Addr::new(127, 0, 0, 0)), prefix_bits: 8 };

    /// Whether an address belongs to this network.
    pub fn contains(&self, address: IpAddr) -> bool {
        match (self.address, address) {
            (IpAddr::V4(own), IpAddr::V4(other)) => {
                let mask = u32::MAX.checked_shl(32 - u32::from(self.prefix_bits)).unwrap_or(0);
                (own.to_bits() ^ other.to_bits()) & mask == 0
            }
            (IpAddr::V6(own), IpAddr::V6(other)) => {
                let mask = u128::MAX.checked_shl(128 - u32::from(self.prefix_bits)).unwrap_or(0);
                (own.to_bits() ^ other.to_bits()) & mask == 0
            }
            (IpAddr::V4(_), IpAddr::V6(other)) => {
                other.to_ipv4_mapped().is_some_and(|other| self.contains(IpAddr::V4(other)))
            }
            (IpAddr::V6(_), IpAddr::V4(_)) => false,
        }
    }
}

impl TryFrom<String> for Network {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let bad = || {
            format!("\"{text}\" is not a network; write an address with a prefix, such as \"192.168.1.0/24\"")
        };
        let (address, prefix) = text.split_once('/').map_or((text.as_str(), None), |(a, p)| (a, Some(p)));
        let address: IpAddr = address.parse().map_err(|_| bad())?;
        let widest = if address.is_ipv4() { 32 } else { 128 };
        let prefix_bits = prefix.map_or(Ok(widest), str::parse).map_err(|_| bad())?;
        if prefix_bits > widest {
            return Err(bad());
        }
        Ok(Self { address, prefix_bits })
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix_bits)
    }
}

/// Rotational inertia about the centre of mass, in the tip frame's axes (kg m^2).
///
/// Written as in a URDF, `[ixx, ixy, ixz, iyy, iyz, izz]`, or as three rows of three.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inertia {
    /// Rows of the symmetric matrix (kg m^2).
    pub rows_kg_m2: [[f64; 3]; 3],
}

impl<'de> Deserialize<'de> for Inertia {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let items = Vec::<toml::Value>::deserialize(deserializer)?;
        let shape = "inertia is [ixx, ixy, ixz, iyy, iyz, izz] or three rows of three numbers";
        let error = || D::Error::custom(shape);
        if items.len() == 6 {
            let v: Vec<f64> = items.iter().map(number).collect::<Option<_>>().ok_or_else(error)?;
            return Ok(Self { rows_kg_m2: [[v[0], v[1], v[2]], [v[1], v[3], v[4]], [v[2], v[4], v[5]]] });
        }
        let mut rows_kg_m2 = [[0.0; 3]; 3];
        if items.len() != 3 {
            return Err(error());
        }
        for (row, item) in rows_kg_m2.iter_mut().zip(&items) {
            let cells = item.as_array().filter(|cells| cells.len() == 3).ok_or_else(error)?;
            for (cell, value) in row.iter_mut().zip(cells) {
                *cell = number(value).ok_or_else(error)?;
            }
        }
        Ok(Self { rows_kg_m2 })
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// Three numbers; a longer array is an error, not cut.
pub(crate) fn three<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    let items = Vec::<f64>::deserialize(deserializer)?;
    <[f64; 3]>::try_from(items.as_slice())
        .map_err(|_| D::Error::custom(format!("expected three numbers [x, y, z], found {}", items.len())))
}

/// Three numbers, where the key is optional.
pub(crate) fn maybe_three<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 3]>, D::Error> {
    three(deserializer).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(text: &str) -> Result<Network, String> {
        Network::try_from(text.to_owned())
    }

    #[test]
    fn networks_contain_their_addresses() {
        let holds = |net: &str, address: &str| network(net).unwrap().contains(address.parse().unwrap());
        assert!(holds("127.0.0.0/8", "127.1.2.3"));
        assert!(holds("127.0.0.0/8", "::ffff:127.0.0.1"));
        assert!(!holds("127.0.0.0/8", "128.0.0.1"));
        assert!(holds("0.0.0.0/0", "9.9.9.9"));
        assert!(holds("10.0.0.7", "10.0.0.7") && !holds("10.0.0.7", "10.0.0.6"));
        assert!(holds("fe80::/10", "fe80::1") && !holds("fe80::/10", "::1") && !holds("::/0", "1.2.3.4"));
        for bad in ["", "127.0.0.0/33", "::/129", "127.0.0.0/-1", "localhost", "1.2.3.4/", "1.2.3/8"] {
            assert!(network(bad).unwrap_err().contains("is not a network"), "{bad}");
        }
    }

    #[test]
    fn signals_have_two_names() {
        let name = SignalName::try_from("Strain12.Counts1".to_owned()).unwrap();
        assert_eq!((name.message.as_str(), name.signal.as_str()), ("Strain12", "Counts1"));
        assert_eq!(name.to_string(), "Strain12.Counts1");
        for bad in ["", "Counts1", ".Counts1", "Strain12.", "a.b.c"] {
            assert!(SignalName::try_from(bad.to_owned()).is_err(), "{bad}");
        }
    }
}
