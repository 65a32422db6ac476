//! Writing CDR.

/// Little-endian, plain CDR.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// One message's bytes as they grow.
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    pub(crate) fn new() -> Self {
        Self(HEADER.to_vec())
    }

    fn align(&mut self, size: usize) {
        while !(self.0.len() - HEADER.len()).is_multiple_of(size) {
            self.0.push(0);
        }
    }

    pub(crate) fn u8(&mut self, value: u8) -> &mut Self {
        self.0.push(value);
        self
    }

    pub(crate) fn bool(&mut self, value: bool) -> &mut Self {
        self.u8(value.into())
    }

    pub(crate) fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
        self
    }

    pub(crate) fn i32(&mut self, value: i32) -> &mut Self {
        self.u32(value as u32)
    }

    pub(crate) fn f64(&mut self, value: f64) -> &mut Self {
        self.align(8);
        self.0.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// A zero inside a string would end it for its readers: it becomes a blank.
    pub(crate) fn string(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.bytes().map(|byte| if byte == 0 { b' ' } else { byte }));
        self.u8(0)
    }

    pub(crate) fn done(self) -> Vec<u8> {
        self.0
    }
}
