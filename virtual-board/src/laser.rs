//! The laser, on channel 4 of TIM4 and the pin PD15, as the sensor head sees it.
//!
//! rigless models the timer and shows no pin. So this module computes the laser's pulse when the firmware
//! starts the timer, from the timer's registers: one-pulse mode, PWM mode 2, no inversion. If the timer is
//! not in this mode, the head reports a violation, because nothing then ends the pulse.

use std::sync::Arc;

use rigless::device::{Device, DeviceContext as Context, RegisterFile as Registers, RequestChange};
use rigless::soc::RegisterSpec;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::tim2::{Register, ccer, ccmr2_output, cr1};
use rigless::soc::stm32f427::peripherals::rcc;
use rigless::soc::stm32f427::peripherals::tim::{Counter, General, Tim};
use rigless::time::{EventId, VirtualNanos};

use crate::base::{Nanos, lock};
use crate::forward::forward;
use crate::port_pin::Pin;
use crate::sensor_head::SharedHead;

/// PWM mode 2: the output is low while the counter is below the compare value (RM0090 section 18.4.8).
const PWM_MODE_2: u64 = 0b111;

/// The output is low, whatever the counter is.
const FORCED_INACTIVE: u64 = 0b100;

/// The function of PD15 that connects it to TIM4 (STM32F429 data sheet, table 12).
const TIMER_FUNCTION: u64 = 2;

/// TIM4.
#[derive(Debug)]
pub struct LaserTimer {
    timer: Tim<General>,
    head: SharedHead,
    hz: u64,
    runs: bool,
    started: Nanos,
}

impl LaserTimer {
    /// A timer that was just reset.
    pub fn new(head: &SharedHead) -> Self {
        Self {
            // As rigless makes it.
            timer: Tim::with_clock(rcc::HSI_HZ, Counter::Narrow),
            head: Arc::clone(head),
            hz: rcc::HSI_HZ,
            runs: false,
            started: 0,
        }
    }

    fn watch(&mut self, written: Register, registers: &Registers, now: VirtualNanos) {
        let control = registers.get(Register::Cr1);
        let runs = cr1::CEN.is_set(control);
        let began = runs && (!self.runs || written == Register::Egr);
        let ended = self.runs && !runs;
        self.runs = runs;
        let mode = ccmr2_output::OC4M.get(registers.get(Register::Ccmr2Output));
        let enable = registers.get(Register::Ccer);
        let is_enabled = ccer::CC4E.is_set(enable);
        let rise = registers.get(Register::Ccr4);
        if !runs && is_enabled && mode == PWM_MODE_2 && rise == 0 {
            let what = "the laser is on while its timer stands still: set the compare value first";
            lock(&self.head).violated(now.0, what);
        }
        if began || ended || !is_enabled || mode == FORCED_INACTIVE {
            lock(&self.head).laser_off(now.0);
        }
        if !runs || !is_enabled || mode == FORCED_INACTIVE {
            return;
        }
        if began {
            self.started = now.0;
        }
        let tick = (registers.get(Register::Psc) + 1) as f64 * 1e9 / self.hz as f64;
        let started = self.started;
        let after = |ticks: u64| started + (ticks as f64 * tick).round() as u64;
        let fall = registers.get(Register::Arr) + 1;
        if !began && written != Register::Arr {
            return;
        }
        if !cr1::OPM.is_set(control) || mode != PWM_MODE_2 || ccer::CC4P.is_set(enable) {
            let what = "the laser's timer started without one-pulse mode: nothing ends the pulse";
            lock(&self.head).violated(now.0, what);
            return;
        }
        if rise < fall {
            lock(&self.head).laser_pulse(after(rise), after(fall));
        }
    }
}

/// Whether PD15 is the output of TIM4.
pub fn is_pin_connected(processor: &Stm32f427) -> bool {
    Pin::of(processor, "GPIOD", 15).has_function(TIMER_FUNCTION)
}

impl Device for LaserTimer {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, registers: &mut Registers, context: &mut Context<'_>) {
        self.hz = hz;
        Device::on_clock(&mut self.timer, hz, registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut Registers, context: &mut Context<'_>) {
        Device::on_event(&mut self.timer, event, registers, context);
        // The timer stops by itself at the end of a pulse.
        self.runs = cr1::CEN.is_set(registers.get(Register::Cr1));
    }

    fn write(&mut self, what: Register, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        Device::write(&mut self.timer, what, value, at, context);
        self.watch(what, at, context.now());
    }

    forward! { Device for timer:
        fn peek(&self, register: Register, registers: &Registers, now: VirtualNanos) -> Option<u64>;
        fn layout(&self) -> &'static [RegisterSpec];
    }

    forward! { Device for timer:
        fn read(&mut self, what: Register, at: &mut Registers, context: &mut Context<'_>) -> Option<u64>;
        fn on_request(&mut self, change: RequestChange, at: &mut Registers, context: &mut Context<'_>);
        fn reset(&mut self);
        fn reset_line(&mut self, registers: &mut Registers, context: &mut Context<'_>);
    }
}
