//! Tells the crate which instructions the target has. Stable Rust shows `cfg` neither the
//! processor's architecture nor its DSP extension, so both are read from the target's name.

fn main() {
    let variable = |name: &str| std::env::var(name).unwrap_or_default();
    let target = variable("TARGET");
    let features = variable("CARGO_CFG_TARGET_FEATURE");
    let is_little_endian = variable("CARGO_CFG_TARGET_ENDIAN") == "little";
    // Cortex-M4 and M7.
    let is_v7em = target.starts_with("thumbv7em-");
    // Cortex-M33 and later, whose makers may leave the DSP extension out.
    let is_v8m = target.starts_with("thumbv8m.main-");
    let has_dsp = is_v7em || is_v8m && features.split(',').any(|feature| feature == "dsp");
    let has_fpu = (is_v7em || is_v8m) && variable("CARGO_CFG_TARGET_ABI") == "eabihf";
    // Cortex-M0, M0+ and M23 multiply to 32 bits.
    let has_long_products =
        !target.starts_with("thumbv6m-") && !target.starts_with("thumbv8m.base-");
    println!("cargo::rustc-check-cfg=cfg(has_dsp, has_fpu, has_long_products)");
    if has_long_products {
        println!("cargo::rustc-cfg=has_long_products");
    }
    if is_little_endian && has_dsp {
        println!("cargo::rustc-cfg=has_dsp");
    }
    if is_little_endian && has_fpu {
        println!("cargo::rustc-cfg=has_fpu");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
