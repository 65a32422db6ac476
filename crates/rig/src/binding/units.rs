//! Units as DBC files write them.

use std::f64::consts::{PI, TAU};

/// Degrees Celsius of 0 K.
const ABSOLUTE_ZERO_C: f64 = -273.15;

/// What a signal must be a quantity of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    /// A gauge's reading: counts, or the torque or strain that a calibrated amplifier makes of them.
    Reading,
    /// Angle (rad).
    Angle,
    /// Angular velocity (rad/s).
    AngularVelocity,
    /// Temperature (degC).
    Temperature,
}

/// value in the product's unit = value in the DBC's unit * factor + offset
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Conversion {
    pub(super) factor: f64,
    pub(super) offset: f64,
}

impl Quantity {
    /// The quantity and the units it may have, for a message.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Reading => "a gauge's reading: counts (or no unit), Nm, mNm, N, mV, mV/V",
            Self::Angle => "an angle: rad, mrad, deg",
            Self::AngularVelocity => "an angular velocity: rad/s, mrad/s, deg/s, rpm",
            Self::Temperature => "a temperature: degC, mdegC, K, mK",
        }
    }

    /// How to convert from `unit`; none where it is no unit of this quantity.
    pub(super) fn conversion(self, unit: &str) -> Option<Conversion> {
        let plain: String =
            unit.chars().filter(|c| !matches!(c, ' ' | '*' | '.' | '\u{b7}' | '[' | ']')).collect();
        let factor = match self {
            Self::Reading => reading(&plain),
            Self::Angle => angle(&plain),
            Self::AngularVelocity => angular_velocity(&plain),
            Self::Temperature => return temperature(&plain),
        };
        factor.map(|factor| Conversion { factor, offset: 0.0 })
    }
}

fn reading(unit: &str) -> Option<f64> {
    let whole = [
        "", "1", "-", "count", "counts", "cnt", "cnts", "ct", "cts", "lsb", "digit", "digits", "raw", "inc",
        "adc",
    ];
    if whole.contains(&unit.to_lowercase().as_str()) {
        return Some(1.0);
    }
    ["Nm", "N", "V/V", "V", "m/m"].iter().find_map(|base| prefixed(unit, base))
}

fn angle(unit: &str) -> Option<f64> {
    match unit.to_lowercase().as_str() {
        "radian" | "radians" => return Some(1.0),
        "degree" | "degrees" | "\u{b0}" => return Some(PI / 180.0),
        "rev" | "turn" | "turns" => return Some(TAU),
        _ => {}
    }
    prefixed(unit, "rad").or_else(|| prefixed(unit, "deg").map(|factor| factor * PI / 180.0))
}

fn angular_velocity(unit: &str) -> Option<f64> {
    if ["rpm", "1/min", "r/min", "rev/min", "min-1", "min^-1"].contains(&unit.to_lowercase().as_str()) {
        return Some(TAU / 60.0);
    }
    if let Some(angle_unit) = unit.strip_suffix("/min") {
        return angle(angle_unit).map(|factor| factor / 60.0);
    }
    unit.strip_suffix("/s").or_else(|| unit.strip_suffix("/sec")).and_then(angle)
}

fn temperature(unit: &str) -> Option<Conversion> {
    let celsius = ["degC", "\u{b0}C", "deg_C", "Celsius", "C"];
    if let Some(factor) = celsius.iter().find_map(|base| prefixed(unit, base)) {
        return Some(Conversion { factor, offset: 0.0 });
    }
    if ["degF", "\u{b0}F"].contains(&unit) {
        return Some(Conversion { factor: 5.0 / 9.0, offset: -160.0 / 9.0 });
    }
    let kelvin = ["K", "degK", "Kelvin"];
    let factor = kelvin.iter().find_map(|base| prefixed(unit, base))?;
    Some(Conversion { factor, offset: ABSOLUTE_ZERO_C })
}

/// Factor of `base` with or without an SI prefix.
fn prefixed(unit: &str, base: &str) -> Option<f64> {
    match unit.strip_suffix(base)? {
        "" => Some(1.0),
        "k" => Some(1e3),
        "d" => Some(1e-1),
        "c" => Some(1e-2),
        "m" => Some(1e-3),
        "u" | "\u{b5}" | "\u{3bc}" => Some(1e-6),
        "n" => Some(1e-9),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(quantity: Quantity, unit: &str, dbc_value: f64) -> Option<f64> {
        quantity.conversion(unit).map(|c| dbc_value * c.factor + c.offset)
    }

    #[test]
    fn known_units_convert() {
        let near = |quantity, unit, from: f64, to: f64| {
            let got = value(quantity, unit, from).unwrap_or_else(|| panic!("{unit} is refused"));
            assert!((got - to).abs() < 1e-12, "{unit}: {got} for {to}");
        };
        for unit in ["", "counts", "Counts", "LSB", "cnt", "Nm", "N.m", "N*m"] {
            near(Quantity::Reading, unit, 5.0, 5.0);
        }
        near(Quantity::Reading, "mNm", 5.0, 0.005);
        near(Quantity::Reading, "mV/V", 2.0, 0.002);
        near(Quantity::Angle, "deg", 180.0, PI);
        near(Quantity::Angle, "\u{b0}", 90.0, PI / 2.0);
        near(Quantity::Angle, "mrad", 1.0, 1e-3);
        near(Quantity::Angle, "mdeg", 1000.0, PI / 180.0);
        near(Quantity::AngularVelocity, "deg/s", 180.0, PI);
        near(Quantity::AngularVelocity, "rpm", 30.0, PI);
        near(Quantity::Temperature, "mdegC", 25_000.0, 25.0);
        near(Quantity::Temperature, "\u{b0}C", 25.0, 25.0);
        near(Quantity::Temperature, "K", 300.0, 26.85);
        near(Quantity::Temperature, "mK", 300_000.0, 26.85);
        near(Quantity::Temperature, "degF", 212.0, 100.0);
    }

    #[test]
    fn other_units_are_refused() {
        let cases = [
            (Quantity::Reading, ["rad", "furlong", "mm", "kg"]),
            (Quantity::Angle, ["", "rad/s", "m", "degC"]),
            (Quantity::AngularVelocity, ["", "rad", "deg", "m/s"]),
            (Quantity::Temperature, ["", "deg", "rad", "counts"]),
        ];
        for (quantity, units) in cases {
            for unit in units {
                assert_eq!(quantity.conversion(unit), None, "{quantity:?} {unit}");
            }
        }
    }
}
