//! Reads the registers, again and again.

use std::time::Duration;

use gearwatch_core::block::Packet;
use tokio::time::timeout;
use tokio_modbus::ExceptionCode;
use tokio_modbus::client::{Context, Reader as _, tcp};
use tokio_modbus::slave::Slave;

use super::{Modbus, Number, Register, RegisterTable};
use crate::readings::Readings;
use crate::{Feed, Sender, SourceContext, SourceError};
use gearwatch_runtime::clock::now_unix_ns;

/// Opens the source.
pub(super) fn open(config: &Modbus, context: &SourceContext) -> Feed {
    let (config, readings) = (config.clone(), context.readings.clone());
    let deadline = context.data_deadline;
    Feed::Push(Box::new(move |sender| {
        Box::pin(async move {
            let error = config.poll(&readings, &sender, deadline).await;
            // Whatever ended it: what it said holds no longer.
            readings.forget(config.registers.iter().map(|register| register.quantity));
            let _ = sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await;
            error.map_err(|e| SourceError::Peer { peer: config.address, message: e.to_string() })
        })
    }))
}

/// Why a controller is given up.
#[derive(Debug, thiserror::Error)]
enum PollError {
    #[error("no answer within {:.1} s", .0.as_secs_f64())]
    Late(Duration),
    #[error(transparent)]
    Connect(#[from] std::io::Error),
    #[error("register {at}: {source}")]
    Exception { at: u16, source: ExceptionCode },
    #[error("register {at}: {source}")]
    Call { at: u16, source: tokio_modbus::Error },
    #[error("register {at}: expected {expected} words, found {found}")]
    Words { at: u16, expected: u16, found: usize },
}

impl Number {
    const fn words(self) -> u16 {
        match self {
            Self::U16 | Self::I16 => 1,
            Self::U32 | Self::I32 | Self::F32 => 2,
        }
    }
}

impl Register {
    /// The physical value; `None` where the answer has another length than asked for.
    fn value(&self, words: &[u16]) -> Option<f64> {
        let bits = |high: u16, low: u16| u32::from(high) << 16 | u32::from(low);
        let number = match (self.encoding, words) {
            (Number::U16, &[word]) => f64::from(word),
            (Number::I16, &[word]) => f64::from(word.cast_signed()),
            (encoding, &[first, second]) => {
                let bits = if self.low_word_first { bits(second, first) } else { bits(first, second) };
                match encoding {
                    Number::U32 => f64::from(bits),
                    Number::I32 => f64::from(bits.cast_signed()),
                    Number::F32 => f64::from(f32::from_bits(bits)),
                    Number::U16 | Number::I16 => return None,
                }
            }
            _ => return None,
        };
        Some(self.linear().of(number))
    }
}

impl Modbus {
    /// Reads until the service stops or an answer fails. A reading that comes too late may be half
    /// read, so that the connection is given up.
    async fn poll(&self, readings: &Readings, sender: &Sender, deadline: Duration) -> Result<(), PollError> {
        let late = |_| PollError::Late(deadline);
        let connect = async {
            let address = tokio::net::lookup_host(&self.address).await?.next();
            let address = address.ok_or_else(|| std::io::Error::other("the host has no address"))?;
            tcp::connect_slave(address, Slave(self.unit_id)).await
        };
        let mut client = timeout(deadline, connect).await.map_err(late)??;
        let mut known = true;
        loop {
            for register in &self.registers {
                let value = timeout(deadline, read(&mut client, register)).await.map_err(late)??;
                readings.set(register.quantity, value, deadline);
            }
            let all = readings.knows(self.registers.iter().map(|register| register.quantity));
            if all != std::mem::replace(&mut known, all) && !all {
                tracing::warn!(peer = self.address, "a register holds no number; the operating point is unknown");
            }
            if sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await.is_err() {
                return Ok(());
            }
            tokio::time::sleep(Duration::from_secs_f64(self.poll_secs)).await;
        }
    }
}

async fn read(client: &mut Context, register: &Register) -> Result<f64, PollError> {
    let (at, words) = (register.register, register.encoding.words());
    let answer = match register.table {
        RegisterTable::Input => client.read_input_registers(at, words).await,
        RegisterTable::Holding => client.read_holding_registers(at, words).await,
    };
    let words = match answer {
        Ok(Ok(words)) => words,
        Ok(Err(source)) => return Err(PollError::Exception { at, source }),
        Err(source) => return Err(PollError::Call { at, source }),
    };
    let wrong = PollError::Words { at, expected: register.encoding.words(), found: words.len() };
    register.value(&words).ok_or(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::readings::Quantity;

    #[test]
    fn analytic_registers_become_physical_values() {
        let of = |encoding, low_word_first, words: &[u16]| {
            let quantity = Quantity::MotorSpeedHz;
            let table = RegisterTable::Holding;
            Register { quantity, table, register: 0, encoding, low_word_first, scale: 0.5, offset: 1.0 }.value(words)
        };
        assert_eq!(of(Number::U16, false, &[65_535]), Some(32_768.5));
        assert_eq!(of(Number::I16, false, &[65_535]), Some(0.5));
        assert_eq!(of(Number::U32, false, &[1, 2]), Some(32_770.0));
        assert_eq!(of(Number::I32, true, &[0xfffe, 0xffff]), Some(0.0));
        // 25.0 is 0x41c80000.
        assert_eq!(of(Number::F32, false, &[0x41c8, 0]), Some(13.5));
        assert_eq!(of(Number::F32, true, &[0, 0x41c8]), Some(13.5));
        assert!(of(Number::F32, false, &[0x7fc0, 0]).unwrap().is_nan());
        assert_eq!(of(Number::U16, false, &[1, 2]), None);
        assert_eq!(of(Number::U32, false, &[1]), None);
    }
}
