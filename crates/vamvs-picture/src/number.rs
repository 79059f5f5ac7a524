//! Numbers as people read them.

/// A number with narrow spaces between thousands.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut grouped = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(digit);
    }
    grouped
}

/// A share as a percentage.
#[must_use]
pub fn percent(share: f64, decimals: usize) -> String {
    format!("{:.decimals$} %", 100.0 * share)
}

/// A length in scene units with four significant digits.
#[must_use]
pub fn length(value: f64) -> String {
    let exponent = value.abs().log10().floor();
    let decimals = if exponent.is_finite() { (3.0 - exponent).clamp(0.0, 12.0) as usize } else { 0 };
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_apart() {
        let plain = |number| grouped(number).replace('\u{202f}', "_");
        assert_eq!([0, 999, 1000, 1_234_567].map(plain), ["0", "999", "1_000", "1_234_567"]);
    }

    #[test]
    fn lengths_have_four_digits_whatever_the_unit() {
        let texts = [0.0, 0.000_123_456, 0.519, 12.345_6, -3.241_59, 98_765.4].map(length);
        assert_eq!(texts, ["0", "0.0001235", "0.5190", "12.35", "-3.242", "98765"]);
    }
}
