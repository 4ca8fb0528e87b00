"""The sensor head as a netlist: parts and wires, checked by SKiDL's rules and against the firmware.

./check runs it. With `--write` it rewrites sensor-head.net (for KiCad's Pcbnew) and the tables of
../hardware.md.

Pin numbers are those of the data sheets as we know them. Check them against the data sheets of the parts that
you buy, the line sensor's and the converter's first.
"""

import re
import sys
from pathlib import Path

from drawing import draw
from skidl import ERC, POWER, SKIDL, TEMPLATE, Net, Part, Pin, generate_netlist
from skidl.logger import erc_logger

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
IN, OUT, PASSIVE = Pin.types.INPUT, Pin.types.OUTPUT, Pin.types.PASSIVE
SUPPLY, SOURCE, TRISTATE = Pin.types.PWRIN, Pin.types.PWROUT, Pin.types.TRISTATE
UNUSED = Pin.types.NOCONNECT

parts = []


def part(ref, value, order, second, footprint, pins, why):
    """A part with pins (number, name, type), noted for the list of parts."""
    made = Part(
        tool=SKIDL,
        name=re.sub(r"\W", "_", value),
        ref_prefix=ref.rstrip("0123456789"),
        dest=TEMPLATE,
        pins=[Pin(num=number, name=name, func=kind) for number, name, kind in pins],
    )(ref=ref, value=value, footprint=footprint, tag=ref)
    parts.append((ref, value, order, second, footprint.split(":")[-1], why))
    return made


def two(ref, value, order, second, footprint, why):
    """A part with two equal pins."""
    return part(ref, value, order, second, footprint, [(1, "1", PASSIVE), (2, "2", PASSIVE)], why)


def resistor(ref, value, why, order="any, 1 %, 0603"):
    return two(ref, value, order, "any", "Resistor_SMD:R_0603_1608Metric", why)


def capacitor(ref, value, why, order):
    size = "0805_2012Metric" if "0805" in order else "0603_1608Metric"
    return two(ref, value, order, "any", f"Capacitor_SMD:C_{size}", why)


# Nets. A net's voltages are in docs/hardware.md.
gnd, v5, v33 = Net("GND"), Net("+5V"), Net("+3V3")
v5_sensor, v33_analog, v5_laser = Net("+5VA"), Net("+3V3A"), Net("+5VL")
for supply in (gnd, v5, v33, v5_sensor, v33_analog, v5_laser):
    supply.drive = POWER
FM, ICG, SH = Net("FM"), Net("ICG"), Net("SH")
FM5, ICG5, SH5 = Net("FM_5V"), Net("ICG_5V"), Net("SH_5V")
FMS, ICGS, SHS = Net("FM_SENSOR"), Net("ICG_SENSOR"), Net("SH_SENSOR")
CS, SCLK, SCLK_ADC, DOUT = Net("CS"), Net("SCLK"), Net("SCLK_ADC"), Net("DOUT")
OS, SUM, AMPLIFIED, ADC_IN = Net("OS"), Net("SUM"), Net("AMPLIFIED"), Net("ADC_IN")
WIPER, OFFSET, OFFSET_TOP, OFFSET_END = Net("WIPER"), Net("OFFSET"), Net("OFFSET_TOP"), Net("OFFSET_END")
LASER_ON, LASER_TTL = Net("LASER_ON"), Net("LASER_TTL")

# The board's pins, as the firmware uses them: the check compares them with src/board/mod.rs.
BOARD = {
    "PE9": (FM, OUT),
    "PF12": (ICG, OUT),
    "PF13": (SH, OUT),
    "PD14": (CS, OUT),
    "PD15": (LASER_ON, OUT),
    "PA5": (SCLK, OUT),
    "PA6": (DOUT, IN),
}
nucleo = part(
    "J1",
    "NUCLEO-F429ZI",
    "ST NUCLEO-F429ZI",
    "none: the firmware is for this board",
    "Connector_PinHeader_2.54mm:PinHeader_2x06_P2.54mm_Vertical",
    [(i + 1, name, kind) for i, (name, (_, kind)) in enumerate(BOARD.items())]
    + [
        (8, "5V", SOURCE),
        (9, "3V3", SOURCE),
        (10, "GND", SOURCE),
        (11, "GND2", PASSIVE),
        (12, "GND3", PASSIVE),
    ],
    "processor; the numbers are those of our own cable's connector",
)
for name, (net, _) in BOARD.items():
    nucleo[name] += net
nucleo["5V"] += v5
nucleo["3V3"] += v33
nucleo["GND", "GND2", "GND3"] += gnd

sensor = part(
    "U1",
    "TCD1304DG",
    "Toshiba TCD1304DG(8Z,K)",
    "TCD1304AP (the type before, same pins)",
    "Package_DIP:DIP-22_W10.16mm",
    [(1, "VDD", SUPPLY), (2, "VAD", SUPPLY), (3, "ICG", IN), (4, "FM", IN), (5, "SH", IN)]
    + [(number, f"NC{number}", UNUSED) for number in range(6, 21)]
    + [(21, "OS", OUT), (22, "SS", SUPPLY)],
    "line sensor",
)
sensor["VDD", "VAD"] += v5_sensor
sensor["SS"] += gnd
sensor["ICG"] += ICGS
sensor["FM"] += FMS
sensor["SH"] += SHS
sensor["OS"] += OS

buffer = part(
    "U2",
    "74AHCT125",
    "Nexperia 74AHCT125D",
    "TI SN74AHCT125D",
    "Package_SO:SOIC-14_3.9x8.7mm_P1.27mm",
    [(1, "1OE", IN), (2, "1A", IN), (3, "1Y", TRISTATE), (4, "2OE", IN), (5, "2A", IN), (6, "2Y", TRISTATE)]
    + [(7, "GND", SUPPLY), (8, "3Y", TRISTATE), (9, "3A", IN), (10, "3OE", IN), (11, "4Y", TRISTATE)]
    + [(12, "4A", IN), (13, "4OE", IN), (14, "VCC", SUPPLY)],
    "3.3 V to 5 V for fM, ICG and SH",
)
buffer["VCC"] += v5_sensor
buffer["GND", "1OE", "2OE", "3OE"] += gnd
# The fourth gate is off, and its input does not float.
buffer["4A"] += gnd
buffer["4OE"] += v5_sensor
buffer["4Y"].do_erc = False
for gate, before, after, wire, ref in (
    (1, FM, FM5, FMS, "R1"),
    (2, ICG, ICG5, ICGS, "R2"),
    (3, SH, SH5, SHS, "R3"),
):
    buffer[f"{gate}A"] += before
    buffer[f"{gate}Y"] += after
    series = resistor(ref, "82R", "no ringing on the wire to the sensor")
    series[1] += after
    series[2] += wire

amplifier = part(
    "U3",
    "OPA2365",
    "TI OPA2365AIDR",
    "none known: see the amplifier",
    "Package_SO:SOIC-8_3.9x4.9mm_P1.27mm",
    [(1, "OUT1", OUT), (2, "IN1-", IN), (3, "IN1+", IN), (4, "V-", SUPPLY)]
    + [(5, "IN2+", IN), (6, "IN2-", IN), (7, "OUT2", OUT), (8, "V+", SUPPLY)],
    "gain of 5, and the offset's buffer",
)
# The converter's own supply: so U3 cannot drive the converter's input beyond its limits.
amplifier["V+"] += v33_analog
amplifier["V-"] += gnd
amplifier["IN1+"] += OS
amplifier["IN1-"] += SUM
amplifier["OUT1"] += AMPLIFIED
amplifier["IN2+"] += WIPER
amplifier["IN2-", "OUT2"] += OFFSET
feedback = resistor("R4", "2k", "gain 1 + 2000/499 = 5.01", "any, 0.1 % or 1 %, 25 ppm/K, 0603")
feedback[1, 2] += AMPLIFIED, SUM
to_offset = resistor("R5", "499R", "as R4", "any, 0.1 % or 1 %, 25 ppm/K, 0603")
to_offset[1, 2] += SUM, OFFSET
trimmer = part(
    "RV1",
    "10k, 25 turns",
    "Bourns 3296W-1-103LF",
    "Vishay T93YA103KT20",
    "Potentiometer_THT:Potentiometer_Bourns_3296W_Vertical",
    [(1, "1", PASSIVE), (2, "WIPER", PASSIVE), (3, "3", PASSIVE)],
    "the offset, 0.6 to 3.27 V",
)
top, end = resistor("R6", "100R", "upper end of the trimmer"), resistor("R7", "2k2", "its lower end")
# From the converter's reference: with 5 V of USB, a tenth of a volt would move the black level by 235 counts.
top[1, 2] += v33_analog, OFFSET_TOP
trimmer[1] += OFFSET_TOP
trimmer["WIPER"] += WIPER
trimmer[3] += OFFSET_END
end[1, 2] += OFFSET_END, gnd
quiet = capacitor("C1", "100n", "no noise on the offset", "any X7R, 16 V, 0603")
quiet[1, 2] += WIPER, gnd

filter_ = resistor("R8", "220R", "keeps C2 and the converter's sampling away from U3")
filter_[1, 2] += AMPLIFIED, ADC_IN
store = capacitor("C2", "100p", "charge for the converter's sampling capacitor", "any C0G, 50 V, 0603")
store[1, 2] += ADC_IN, gnd
converter = part(
    "U4",
    "ADC122S101",
    "TI ADC122S101CIMM/NOPB",
    "ADC121S101 has other pins; no drop-in part is known",
    "Package_SO:VSSOP-8_3.0x3.0mm_P0.65mm",
    [(1, "CS", IN), (2, "VA", SUPPLY), (3, "GND", SUPPLY), (4, "IN2", IN), (5, "IN1", IN)]
    + [(6, "DIN", IN), (7, "DOUT", TRISTATE), (8, "SCLK", IN)],
    "12 bits, 656,250 conversions a second",
)
converter["VA"] += v33_analog
# DIN at ground selects IN1; IN2 is not used and must not float.
converter["GND", "DIN", "IN2"] += gnd
converter["IN1"] += ADC_IN
converter["CS"] += CS
converter["SCLK"] += SCLK_ADC
converter["DOUT"] += DOUT
source = resistor("R9", "33R", "at the board's pin: no ringing on SCLK")
source[1, 2] += SCLK, SCLK_ADC
for ref, net, why in (("R10", SCLK_ADC, "SCLK floats between rows"), ("R11", CS, "CS floats in a reset")):
    pull_up = resistor(ref, "10k", why)
    pull_up[1, 2] += net, v33

regulator = part(
    "U5",
    "LP5907-3.3",
    "TI LP5907MFX-3.3/NOPB",
    "Microchip MCP1700T-3302E/TT (other pins, more noise)",
    "Package_TO_SOT_SMD:SOT-23-5",
    [(1, "IN", SUPPLY), (2, "GND", SUPPLY), (3, "EN", IN), (4, "NC", UNUSED), (5, "OUT", SOURCE)],
    "the converter's supply is its reference",
)
regulator["IN", "EN"] += v5_sensor
regulator["GND"] += gnd
regulator["OUT"] += v33_analog
for ref, net, rest in (("R14", FM, gnd), ("R15", ICG, v33), ("R16", SH, gnd)):
    at_rest = resistor(ref, "100k", "U2's inputs float in a reset")
    at_rest[1, 2] += net, rest
for ref, net in (("FB1", v5_sensor), ("FB2", v5_laser)):
    bead = two(
        ref,
        "600R at 100 MHz",
        "Murata BLM18AG601SN1D",
        "TDK MPZ1608S601ATA00",
        "Inductor_SMD:L_0603_1608Metric",
        "keeps the board's noise out" if ref == "FB1" else "keeps the laser's pulses out",
    )
    bead[1, 2] += v5, net
for ref, value, net, why in (
    ("C3", "10u", v5_sensor, "supply of the head"),
    ("C4", "100n", v5_sensor, "at U1, pins 1 and 2"),
    ("C5", "100n", v5_sensor, "at U2, pin 14"),
    ("C6", "100n", v33_analog, "at U3, pin 8"),
    ("C7", "1u", v5_sensor, "at U5, pin 1"),
    ("C8", "1u", v33_analog, "at U5, pin 5"),
    ("C9", "100n", v33_analog, "at U4, pin 2"),
    ("C10", "10u", v5_laser, "supply of the laser"),
):
    size = "0805" if value == "10u" else "0603"
    decoupling = capacitor(ref, value, why, f"any X7R, 16 V, {size}")
    decoupling[1, 2] += net, gnd

laser = part(
    "J2",
    "laser module, TTL",
    "650 nm, at most 1 mW, class 2, 5 V, TTL input that is off when low",
    "most cheap modules with TTL have 5 mW: do not take them",
    "Connector_PinHeader_2.54mm:PinHeader_1x03_P2.54mm_Vertical",
    [(1, "+5V", SUPPLY), (2, "TTL", IN), (3, "GND", SUPPLY)],
    "laser",
)
laser["+5V"] += v5_laser
laser["GND"] += gnd
laser["TTL"] += LASER_TTL
for ref, value, ends, why in (
    ("R12", "100R", (LASER_ON, LASER_TTL), "protects the board's pin"),
    ("R13", "1k", (LASER_TTL, gnd), "the laser is off in a reset, also if its input has a pull-up"),
):
    at_laser = resistor(ref, value, why)
    at_laser[1, 2] += ends


#: For each net: at rest, in a row, and who drives it. Seen with a scope whose ground is at U1, pin 22.
VOLTAGES = {
    "GND": ("0 V", "", "the board"),
    "+5V": ("4.7 to 5.25 V", "", "the board's 5V pin, from USB"),
    "+3V3": ("3.3 V", "", "the board"),
    "+5VA": ("as +5V", "below 10 mV of ripple", "FB1"),
    "+5VL": ("as +5V", "falls while the laser is on", "FB2"),
    "+3V3A": ("3.23 to 3.37 V", "below 1 mV of ripple", "U5"),
    "FM": ("2.625 MHz", "0 and 3.3 V, half of the time each", "PE9"),
    "FM_5V": ("as FM", "0 and 5 V", "U2"),
    "FM_SENSOR": ("as FM", "0 and 5 V, rounded", "R1"),
    "ICG": ("3.3 V", "0 V for about 7 us", "PF12"),
    "ICG_5V": ("5 V", "0 V for about 7 us", "U2"),
    "ICG_SENSOR": ("5 V", "0 V for about 7 us", "R2"),
    "SH": ("0 V", "3.3 V for 3.0 us", "PF13"),
    "SH_5V": ("0 V", "5 V for 3.0 us", "U2"),
    "SH_SENSOR": ("0 V", "5 V for 3.0 us, rounded: 600 pF", "R3"),
    "CS": ("3.3 V", "0 V for 5.63 ms", "PD14; R11 in a reset"),
    "SCLK": ("3.3 V", "10.5 MHz, 0 and 3.3 V", "PA5; R10 between rows"),
    "SCLK_ADC": ("3.3 V", "as SCLK", "R9"),
    "DOUT": ("3.3 V", "0 and 3.3 V", "U4; a pull-up within the chip"),
    "OS": ("2.5 V (1.5 to 3.5 V)", "0.6 V lower at a full well", "U1"),
    "SUM": ("as OS", "as OS", "R4, R5"),
    "AMPLIFIED": ("3.06 V, trimmed", "0.05 V at a full well; U3 stops 10 mV before 0 V and `+3V3A`", "U3"),
    "ADC_IN": ("3.06 V, trimmed", "as AMPLIFIED", "R8"),
    "WIPER": ("2.36 V (1.1 to 3.3 V)", "", "RV1"),
    "OFFSET": ("as WIPER", "", "U3"),
    "OFFSET_TOP": ("3.27 V", "", "R6, RV1"),
    "OFFSET_END": ("0.59 V", "", "RV1, R7"),
    "LASER_ON": ("0 V", "3.3 V for the exposure", "PD15"),
    "LASER_TTL": ("0 V", "3.0 V for the exposure", "R12; R13 in a reset"),
}


def table(head, lines):
    rows = [head, ["---"] * len(head), *lines]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def place(pin):
    """Where a pin stands in a list."""
    return pin.part.ref[0], int(re.sub(r"\D", "", pin.part.ref)), int(pin.num)


def nets_of_page():
    nets = {net.name: net for net in gnd.circuit.nets if net.pins}
    lines = []
    for name, voltages in VOLTAGES.items():
        pins = sorted(nets[name].pins, key=place)
        ends = [
            f"{pin.part.ref}.{pin.num} {pin.name}" if pin.part.ref[0] in "UJ" else f"{pin.part.ref}.{pin.num}"
            for pin in pins
        ]
        lines.append([f"`{name}`", *voltages, ", ".join(ends)])
    return table(["net", "at rest", "in a row", "driven by", "pins that it joins"], lines)


def parts_of_page():
    groups = {}
    for ref, value, order, second, _, why in parts:
        groups.setdefault((value, order, second), []).append((ref, why))
    lines = []
    for (value, order, second), of in groups.items():
        refs = ", ".join(ref for ref, _ in of)
        whys = "; ".join(dict.fromkeys(why for _, why in of))
        lines.append([refs, str(len(of)), value, order, second, whys])
    return table(["part", "", "value", "order number", "second source", "what for"], lines)


def with_blocks(page):
    for name, block in (("parts", parts_of_page()), ("nets", nets_of_page())):
        mark = f"<!-- docs/hardware/check, {name} -->\n"
        before, rest = page.split(mark)
        page = f"{before}{mark}\n{block}\n<!-- end -->{rest.split('<!-- end -->', 1)[1]}"
    return page


def drawn():
    """The schematic as a picture."""
    found = {one.ref: one for one in gnd.circuit.parts}
    return draw(
        lambda ref: found[ref].value,
        lambda ref, pin: found[ref][pin].net.name,
        lambda ref, pin: found[ref][pin].num,
    )


def netlist():
    """The netlist as KiCad reads it, without what changes from run to run."""
    text = generate_netlist(tool="kicad8")
    text = re.sub(r'\(date "[^"]*"\)', '(date "")', text)
    text = re.sub(r'\(source "[^"]*"\)', '(source "sensor-head.py")', text)
    text = re.sub(r'\(tool "[^"]*"\)', '(tool "SKiDL")', text)
    return re.sub(r'\s*\(field\s*\(name "SKiDL Line"\) "[^"]*"\)', "", text)


def firmware_pins():
    """The pins of the sensor head in the table of src/board/mod.rs: pin and signal."""
    table = re.findall(r"^//! \| (P[^|]+) \|[^|]*\| ([^|]+) \|$", (ROOT / "src/board/mod.rs").read_text(), re.M)
    head = {}
    for pins, signals in table:
        device, *names = [word.strip() for word in signals.split(",")]
        if device in ("sensor", "converter"):
            head.update(zip([pin.strip() for pin in pins.split(",")], names))
        elif device == "laser":
            head[pins.strip()] = "laser"
    return head


#: What the firmware calls a signal, and the pin of a part that it must reach.
SIGNALS = {
    "fM": (sensor, "FM"),
    "ICG": (sensor, "ICG"),
    "SH": (sensor, "SH"),
    "chip select": (converter, "CS"),
    "SCLK": (converter, "SCLK"),
    "DOUT": (converter, "DOUT"),
    "laser": (laser, "TTL"),
}


def reaches(start, end):
    """Whether a net is a pin's, or comes to it through one resistor, or through the buffer and one."""
    seen, ends = set(), {start.name}
    while ends - seen:
        seen |= ends
        for net in [net for net in (start.circuit.nets) if net.name in ends]:
            for pin in net.pins:
                ref = pin.part.ref
                if ref in ("R1", "R2", "R3", "R9", "R12"):
                    ends |= {other.net.name for other in pin.part.pins}
                elif ref == "U2" and pin.name.endswith("A"):
                    ends.add(buffer[pin.name[0] + "Y"].net.name)
    return end.net.name in ends


def undefined_in_reset():
    """Inputs on a processor's output, directly or through resistors, that no resistor holds in a reset.

    The processor's pins float in a reset. A supply is where a search ends, and what it looks for.
    """
    found = []
    for name, (start, kind) in BOARD.items():
        if kind != OUT:
            continue
        nets, ends, held = [start], set(), False
        for net in nets:
            for pin in net.pins:
                if pin.func == IN:
                    ends.add(f"{pin.part.ref} {pin.name}")
                if not pin.part.ref.startswith("R"):
                    continue
                for other in (other.net for other in pin.part.pins if other is not pin):
                    if other.drive == POWER:
                        held = True
                    elif other.name not in [seen.name for seen in nets]:
                        nets.append(other)
        if ends and not held:
            found.append(f"{', '.join(sorted(ends))} floats in a reset: no resistor holds the net of {name}")
    return found


def main():
    wrong = []
    ERC()
    if erc_logger.error.count or erc_logger.warning.count:
        wrong.append("SKiDL's rules: see above")
    expected = firmware_pins()
    if set(expected) != set(BOARD):
        wrong.append(f"src/board/mod.rs has the pins {sorted(expected)}, the netlist has {sorted(BOARD)}")
    for pin, signal in expected.items():
        device, name = SIGNALS[signal]
        if pin in BOARD and not reaches(BOARD[pin][0], device[name]):
            wrong.append(f"{pin} is {signal} in src/board/mod.rs, but does not reach {device.ref} {name}")
    wrong += undefined_in_reset()
    if amplifier["V+"].net.name != converter["VA"].net.name:
        wrong.append("U3 can exceed the limits of U4's input: its supply is not U4's")
    nets = [net.name for net in gnd.circuit.nets if net.pins]
    if set(nets) != set(VOLTAGES):
        wrong.append(f"VOLTAGES has other nets than the netlist: {set(nets) ^ set(VOLTAGES)}")
    if wrong:
        return report(wrong)
    page = HERE.parent / "hardware.md"
    for file, text in (
        (HERE / "sensor-head.net", netlist()),
        (HERE / "sensor-head.svg", drawn()),
        (page, with_blocks(page.read_text())),
    ):
        if "--write" in sys.argv:
            file.write_text(text)
        elif not file.exists() or file.read_text() != text:
            wrong.append(f"{file.name} is not what sensor-head.py writes: run docs/hardware/check --write")
    print(f"{len(parts)} parts, {len(nets)} nets, {len(expected)} pins as in src/board/mod.rs")
    return report(wrong)


def report(wrong):
    for what in wrong:
        print(f"WRONG: {what}", file=sys.stderr)
    return 1 if wrong else 0


sys.exit(main())
