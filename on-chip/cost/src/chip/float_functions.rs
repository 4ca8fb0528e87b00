//! The exponential, the logarithm and the square root by each library.

use core::hint::black_box;

use cost_on_chip::float_functions::{self, ARGUMENTS, Function, Library};

use super::counter::{self, Cost, Counted};

/// Calls for each argument. The emulator's cycle counter is off by up to two; the mean of so many is not.
const CALLS: u32 = 64;

/// Counts each function with each argument. What a function that only copies its argument takes is
/// subtracted.
pub fn measure() {
    for ((function, _, name), counted) in float_functions::ALL.into_iter().zip(FUNCTIONS) {
        let costs: [Cost; ARGUMENTS] = core::array::from_fn(|i| {
            let (argument, mut value) = (function.argument(i), 0.0);
            let copied = counter::count(copy, &argument, &mut value);
            let cost = counter::count(counted, &argument, &mut value);
            Cost {
                cycles: cost.cycles.saturating_sub(copied.cycles),
                stack: cost.stack,
            }
        });
        counter::print("float", name, ("calls", CALLS as f32), costs);
    }
}

/// Calls a function again and again. The argument stays behind its pointer, so that the compiler computes no
/// value before the loop.
#[inline(always)]
fn repeat(argument: &f32, value: &mut f32, function: impl Fn(f32) -> f32) {
    for _ in 0..CALLS {
        *black_box(&mut *value) = function(*black_box(argument));
    }
}

#[inline(never)]
extern "C" fn copy(argument: &f32, value: &mut f32) {
    repeat(argument, value, |argument| argument);
}

/// Gives each function of each library a function of its own that is counted.
macro_rules! functions {
    ($($name:ident: $function:ident $library:ident,)*) => {
        /// In the order of [`float_functions::ALL`].
        const FUNCTIONS: [Counted<f32, f32>; float_functions::ALL.len()] = [$($name,)*];
        $(
            #[inline(never)]
            extern "C" fn $name(argument: &f32, value: &mut f32) {
                repeat(argument, value, |argument| {
                    float_functions::call(Function::$function, Library::$library, argument)
                });
            }
        )*
    };
}

functions! {
    exp_libm: Exp Libm,
    exp_micromath: Exp Micromath,
    ln_libm: Ln Libm,
    ln_micromath: Ln Micromath,
    square_root_libm: SquareRoot Libm,
    square_root_micromath: SquareRoot Micromath,
    square_root_dual_mac: SquareRoot DualMac,
}
