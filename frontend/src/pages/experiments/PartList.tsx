import { ActionIcon, Button, NativeSelect } from "@mantine/core";
import type { DragEvent } from "react";
import { TbArrowDown, TbArrowUp, TbCopy, TbGripVertical, TbPlus, TbRepeat, TbX } from "react-icons/tb";
import { pluralized, short } from "../../samples/format";
import { type AngleUnit, formatWithUnit } from "../../samples/quantity";
import { useAngleUnit } from "../../service/api/preferences";
import { useRefusedInput, useRefusedWithin } from "../../service/forms/refusals";
import type { PartPlayed } from "../../wire/types";
import { ExpressionField } from "./CriteriaEditor";
import { innerOf, numberOf, type Part, type Place, type Value } from "./document";
import styles from "./SequenceEditor.module.css";

/** The parts that an experiment may have, as forms: which boxes each has, and how a new one begins. Pure. */

interface Box {
  readonly name: string;
  readonly words: string;
  readonly unit: string;
  /** May be left out: what it names stays as it is, or is as usual. */
  readonly optional?: boolean;
  readonly choices?: readonly string[];
}

interface PartForm {
  readonly words: string;
  readonly boxes: readonly Box[];
  /** What a new one has. */
  readonly begins: Readonly<Record<string, Value | Part[]>>;
}

const box = (name: string, words: string, unit: string): Box => ({ name, words, unit });
const maybe = (name: string, words: string, unit: string): Box => ({ name, words, unit, optional: true });

const TIME = box("duration_s", "Time", "s");
const AIM = [maybe("q_ref", "q_ref", "rad"), maybe("S_ref", "S_ref", "N·m/rad")];
const PUSH = maybe("F_push", "Push", "N");
const AMPLITUDES = [
  maybe("q_amplitude", "Amplitude of q", "rad"),
  maybe("S_amplitude", "Amplitude of S", "N·m/rad"),
];

export const PART_FORMS: Readonly<Record<string, PartForm>> = {
  hold: { words: "Hold", boxes: [TIME], begins: { duration_s: 2 } },
  step: { words: "Step", boxes: [...AIM, TIME, PUSH], begins: { q_ref: 0, duration_s: 2 } },
  ramp: { words: "Ramp", boxes: [...AIM, TIME, PUSH], begins: { q_ref: 0, duration_s: 2 } },
  pulse: {
    words: "Pulse",
    boxes: [...AIM, TIME, box("rest_s", "Rest", "s")],
    begins: { q_ref: 0.2, duration_s: 2, rest_s: 2 },
  },
  sine: {
    words: "Sine",
    boxes: [
      ...AMPLITUDES,
      maybe("q_ref", "Crest of q", "rad"),
      maybe("S_ref", "Crest of S", "N·m/rad"),
      box("period_s", "Period", "s"),
      TIME,
      PUSH,
    ],
    begins: { q_amplitude: 0.2, period_s: 4, duration_s: 8 },
  },
  sweep: {
    words: "Sweep",
    boxes: [...AMPLITUDES, box("from_Hz", "From", "Hz"), box("to_Hz", "To", "Hz"), TIME],
    begins: { q_amplitude: 0.05, from_Hz: 0.1, to_Hz: 1, duration_s: 20 },
  },
  prbs: {
    words: "PRBS",
    boxes: [
      ...AMPLITUDES,
      box("chip_s", "Chip", "s"),
      box("bits", "Bits", "1"),
      maybe("periods", "Periods", "1"),
    ],
    begins: { q_amplitude: 0.05, chip_s: 0.2, bits: 6 },
  },
  multisine: {
    words: "Multisine",
    boxes: [
      ...AMPLITUDES,
      box("period_s", "Period", "s"),
      box("lines", "Lines", "1"),
      maybe("periods", "Periods", "1"),
    ],
    begins: { q_amplitude: 0.05, period_s: 8, lines: 10 },
  },
  push: {
    words: "Push",
    boxes: [
      box("F_push", "Force", "N"),
      TIME,
      { name: "shape", words: "Shape", unit: "1", choices: ["step", "ramp", "smooth"] },
    ],
    begins: { F_push: 5, duration_s: 2, shape: "step" },
  },
  hand: {
    words: "Hand",
    boxes: [
      box("F_push", "Force", "N"),
      box("pushes", "Pushes", "1"),
      box("pause_s", "Pause", "s"),
      maybe("seed", "Seed", "1"),
    ],
    begins: { F_push: 5, pushes: 3, pause_s: 2 },
  },
  load: {
    words: "Load of the shafts",
    boxes: [maybe("load_A", "Load A", "N·m"), maybe("load_B", "Load B", "N·m"), TIME],
    begins: { load_A: 0.05, duration_s: 2 },
  },
  wall: {
    words: "Wall",
    boxes: [
      box("q_wall", "q_wall", "rad"),
      { name: "side", words: "Stands", unit: "1", choices: ["above", "below"] },
      maybe("k_wall", "Stiffness", "N/m"),
      maybe("c_wall", "Damping", "s/m"),
    ],
    begins: { q_wall: 0.5, side: "above" },
  },
  no_wall: { words: "No wall", boxes: [], begins: {} },
  tuning: {
    words: "Tuning",
    boxes: [
      maybe("lam_q", "λ_q", "s"),
      maybe("lam_S", "λ_S", "s"),
      maybe("lam_motor", "λ_motor", "s"),
      maybe("b", "b", "1"),
      maybe("bank", "Bank", "1"),
      { name: "motion", words: "Motion", unit: "1", choices: ["lambda", "time-optimal"], optional: true },
      maybe("u_plan", "Voltage limit", "V"),
      maybe("k_ext", "k_ext", "1"),
    ],
    begins: { lam_q: 0.8 },
  },
  learn: { words: "Learn", boxes: [maybe("duration_s", "Time", "s")], begins: { duration_s: 2 } },
  until_contact: {
    words: "Until contact",
    boxes: [maybe("contact_N", "Contact", "N")],
    begins: { contact_N: 1.5, parts: [{ do: "hold", duration_s: 2 }] },
  },
  repeat: {
    words: "Repeat",
    boxes: [box("times", "Times", "1")],
    begins: { times: 2, parts: [{ do: "hold", duration_s: 2 }] },
  },
};

/** A new part of a kind; of another one it keeps what both have, so that a step becomes a ramp to the same place. */
export function partOf(kind: string, other?: Part): Part {
  const form = PART_FORMS[kind];
  const kept = Object.fromEntries(
    Object.entries(other ?? {}).filter(
      ([name]) =>
        name !== "do" &&
        form?.boxes.some((one) => one.name === name) &&
        // where another motion goes is no crest of a sine
        !(kind === "sine" && other?.do !== "sine" && AIM.some((one) => one.name === name)),
    ),
  );
  const begins = form?.begins ?? {};
  const inner = other === undefined ? undefined : innerOf(other)[0]?.[1];
  const parts = "parts" in begins && inner !== undefined ? { parts: [...inner] } : {};
  // a reference that the other leaves as it is is none that a new one would move
  const aims = "q_ref" in kept || "S_ref" in kept ? { ...begins, q_ref: undefined } : begins;
  // a sine that was something else is one whole period as long as that
  const period =
    kind === "sine" && !("period_s" in kept) && "duration_s" in kept ? { period_s: kept.duration_s } : {};
  return stripped({ do: kind, ...aims, ...kept, ...period, ...parts });
}

/** A part without what is left out. */
function stripped(part: Part): Part {
  return Object.fromEntries(Object.entries(part).filter(([, value]) => value !== undefined)) as Part;
}

/** What a part will do, in words: from what is written, and from what the service has laid out of it. Pure. */

/** A number with its unit as it is read; an expression as it is written; null for what is left out. */
function said(part: Part, name: string, unit: string, angles: AngleUnit): string | null {
  const value = part[name];
  if (typeof value === "number") return formatWithUnit(value, unit, angles);
  return typeof value === "string" ? value : null;
}

function aim(part: Part, angles: AngleUnit): string {
  const q = said(part, "q_ref", "rad", angles);
  const S = said(part, "S_ref", "N·m/rad", angles);
  const named = [q === null ? null : `q to ${q}`, S === null ? null : `S to ${S}`].filter(
    (one) => one !== null,
  );
  return named.length === 0 ? "nothing" : named.join(" and ");
}

function swing(part: Part, angles: AngleUnit): string {
  const q = part.q_amplitude === 0 ? null : said(part, "q_amplitude", "rad", angles);
  const S = part.S_amplitude === 0 ? null : said(part, "S_amplitude", "N·m/rad", angles);
  const q_crest = said(part, "q_ref", "rad", angles);
  const S_crest = said(part, "S_ref", "N·m/rad", angles);
  const named = [
    q === null ? null : `q by ±${q}`,
    S === null ? null : `S by ±${S}`,
    q_crest === null ? null : `q to ${q_crest} at the crest`,
    S_crest === null ? null : `S to ${S_crest} at the crest`,
  ].filter((one) => one !== null);
  return named.length === 0 ? "nothing" : named.join(" and ");
}

/** The push beside a motion; "" where there is none. */
function push(part: Part, angles: AngleUnit): string {
  const force = part.F_push === 0 ? null : said(part, "F_push", "N", angles);
  return force === null ? "" : `, pushed with ${force}, on the simulator`;
}

/** What is written. */
export function describePart(part: Part, angles: AngleUnit): string {
  const time = said(part, "duration_s", "s", angles) ?? "";
  const of = (name: string, unit: string) => said(part, name, unit, angles) ?? "…";
  switch (part.do) {
    case "hold":
      return `holds the references for ${time}`;
    case "step":
      return `jumps ${aim(part, angles)}, stays ${time}${push(part, angles)}`;
    case "ramp":
      return `ramps ${aim(part, angles)} in ${time}${push(part, angles)}`;
    case "pulse":
      return `jumps ${aim(part, angles)} for ${time}, and back for ${of("rest_s", "s")}`;
    case "sine":
      return `swings ${swing(part, angles)} with a period of ${of("period_s", "s")}${turns(part)} for ${time}${fastest(part, angles)}${push(part, angles)}`;
    case "sweep":
      return `swings ${swing(part, angles)} from ${of("from_Hz", "Hz")} to ${of("to_Hz", "Hz")} in ${time}`;
    case "prbs":
      return `jumps ${swing(part, angles)} by a binary sequence of ${of("bits", "1")} bits, ${of("chip_s", "s")} each`;
    case "multisine":
      return `swings ${swing(part, angles)} by ${of("lines", "1")} harmonics of ${of("period_s", "s")}`;
    case "push":
      return `pushes the joint with ${of("F_push", "N")} for ${time}, on the simulator`;
    case "hand":
      return `pushes ${of("pushes", "1")} times like a hand, up to ${of("F_push", "N")}, on the simulator`;
    case "load":
      return `loads the motors' shafts for ${time}, on the simulator`;
    case "wall":
      return `puts a wall ${part.side ?? "above"} ${of("q_wall", "rad")}, on the simulator`;
    case "no_wall":
      return "takes the wall away";
    case "tuning":
      return tuning(part, angles);
    case "learn":
      return `rests ${time || "2 s"}: what the outside force reads is taken off from then on`;
    case "until_contact":
      return `plays its parts until a force above ${said(part, "contact_N", "N", angles) ?? "1.5 N"} is felt`;
    case "repeat":
      return `plays its parts ${of("times", "1")} times; ${part.index ?? "i"} counts from 0`;
    case "choose":
      return `plays the parts under the value of ${part.by}`;
    default:
      return "is not known";
  }
}

function turns({ duration_s, period_s }: Part): string {
  if (typeof duration_s !== "number" || typeof period_s !== "number" || period_s <= 0) return "";
  const count = Number((duration_s / period_s).toPrecision(3));
  return `, ${Number.isInteger(count) ? pluralized(count, "turn") : `${short(count)} turns`},`;
}

/** The largest rate of a sine of q, a·2π/T. */
function fastest({ q_amplitude, period_s }: Part, angles: AngleUnit): string {
  if (typeof q_amplitude !== "number" || typeof period_s !== "number" || period_s <= 0 || q_amplitude === 0)
    return "";
  return `, ${rate((Math.abs(q_amplitude) * 2 * Math.PI) / period_s, "rad/s", angles)} at most`;
}

function tuning(part: Part, angles: AngleUnit): string {
  const named = Object.entries(part).filter(([name]) => name !== "do");
  const words: Record<string, string> = {
    lam_q: "λ_q",
    lam_S: "λ_S",
    lam_motor: "λ_motor",
    u_plan: "U_plan",
  };
  const units: Record<string, string> = { lam_q: "s", lam_S: "s", lam_motor: "s", u_plan: "V" };
  const parts = named.map(([name, value]) => {
    const shown =
      typeof value === "boolean" ? (value ? "yes" : "no") : said(part, name, units[name] ?? "1", angles);
    return `${words[name] ?? name} = ${shown}`;
  });
  return parts.length === 0 ? "changes nothing of the tuning" : `from the next motion on ${parts.join(", ")}`;
}

/** What the service has laid out of it: when, and how fast a ramp is. */
export function describePlayed(part: Part, played: PartPlayed, angles: AngleUnit): string {
  const words = [`at ${short(played.start_s)} to ${formatWithUnit(played.end_s, "s", angles)}`];
  if (part.do === "ramp" && played.piece_s > 0) {
    for (const [name, from, to, unit] of [
      ["q", played.q_from, played.q_to, "rad"],
      ["S", played.S_from, played.S_to, "N·m/rad"],
    ] as const) {
      if (from === null || from === to) continue;
      const speed = rate((to - from) / played.piece_s, unit === "rad" ? "rad/s" : "N·m/rad/s", angles);
      words.push(`${name} from ${formatWithUnit(from, unit, angles)}, ${speed}`);
    }
  }
  return words.join(", ");
}

function rate(value: number, unit: string, angles: AngleUnit): string {
  return formatWithUnit(Number(value.toPrecision(3)), unit, angles).replace(
    /^(−?)(\d+\.?\d*)/,
    (_, sign, number) => `${sign}${short(Number(number), 3)}`,
  );
}

/** Parts one after the other: the boxes of each, what it will do in words, what moves it. A loop has its parts within. */

/** What a row may ask of the editor it stands in. */
export interface Composing {
  /** By place; empty while what the service has laid out is of another text. */
  readonly played: ReadonlyMap<string, PartPlayed>;
  replace(place: Place, part: Part): void;
  insert(place: Place, part: Part): void;
  remove(place: Place): void;
  /** By one place, into loops and out of them; the button that asked keeps the focus. */
  shift(place: Place, by: -1 | 1): void;
  canShift(place: Place, by: -1 | 1): boolean;
  drag(from: Place, event: DragEvent): void;
  drop(before: Place): void;
}

interface PartListProps {
  readonly place: Place;
  readonly parts: readonly Part[];
  readonly composing: Composing;
}

/** With a place to drop a part and to add one at their end. */
export function PartList({ place, parts, composing }: PartListProps) {
  const end = [...place, parts.length];
  return (
    <ol className={styles.list}>
      {parts.map((part, index) => (
        <PartRow
          // biome-ignore lint/suspicious/noArrayIndexKey: a part is its place in the sequence
          key={index}
          part={part}
          place={[...place, index]}
          alone={parts.length === 1}
          composing={composing}
        />
      ))}
      <li
        className={styles.end}
        onDragOver={(event) => {
          event.preventDefault();
          event.stopPropagation();
        }}
        onDrop={(event) => {
          event.preventDefault();
          event.stopPropagation();
          composing.drop(end);
        }}
      >
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          aria-label={`Add part ${numberOf(end)}`}
          onClick={() => composing.insert(end, parts.at(-1) ?? partOf("hold"))}
        >
          Add part
        </Button>
      </li>
    </ol>
  );
}

interface PartRowProps {
  readonly part: Part;
  readonly place: Place;
  readonly alone: boolean;
  readonly composing: Composing;
}

function PartRow({ part, place, alone, composing }: PartRowProps) {
  const angles = useAngleUnit();
  const key = place.join(".");
  const number = numberOf(place);
  const whose = `of part ${number}`;
  const messageId = `refused-${key.replaceAll(".", "-")}`;
  const form = PART_FORMS[part.do];
  const kinds = Object.entries(PART_FORMS).map(([value, { words }]) => ({ value, label: words }));
  const { ref, said } = useRefusedInput<HTMLSelectElement>(key, messageId);
  const set = (name: string, value: unknown) =>
    composing.replace(place, stripped({ ...part, [name]: value } as Part));
  const played = composing.played.get(key);
  return (
    <li
      className={styles.part}
      data-place={key}
      aria-label={`Part ${number}`}
      onDragOver={(event) => {
        event.preventDefault();
        event.stopPropagation();
      }}
      onDrop={(event) => {
        event.preventDefault();
        event.stopPropagation();
        composing.drop(place);
      }}
    >
      <div className={styles.head}>
        {/* biome-ignore lint/a11y/noStaticElementInteractions: the buttons beside it do the same by keyboard */}
        <span
          className={styles.grip}
          draggable
          title="Drag"
          onDragStart={(event) => composing.drag(place, event)}
        >
          <TbGripVertical size={14} aria-hidden />
          {number}
        </span>
        <NativeSelect
          ref={ref}
          size="xs"
          aria-label={`Kind ${whose}`}
          error={said !== null}
          data={form === undefined ? [{ value: part.do, label: part.do }, ...kinds] : kinds}
          value={part.do}
          onChange={(event) => composing.replace(place, partOf(event.currentTarget.value, part))}
        />
        <span className={styles.words}>
          {describePart(part, angles)}
          {played && <span className={styles.played}> {describePlayed(part, played, angles)}</span>}
        </span>
        <span className={styles.buttons}>
          <RowButton
            words={`Move up part ${number}`}
            name="up"
            off={!composing.canShift(place, -1)}
            onClick={() => composing.shift(place, -1)}
          >
            <TbArrowUp size={14} />
          </RowButton>
          <RowButton
            words={`Move down part ${number}`}
            name="down"
            off={!composing.canShift(place, 1)}
            onClick={() => composing.shift(place, 1)}
          >
            <TbArrowDown size={14} />
          </RowButton>
          <RowButton
            words={`Repeat part ${number}`}
            name="repeat"
            onClick={() => composing.replace(place, { do: "repeat", times: 2, parts: [part] })}
          >
            <TbRepeat size={14} />
          </RowButton>
          <RowButton words={`Copy part ${number}`} name="copy" onClick={() => composing.insert(place, part)}>
            <TbCopy size={14} />
          </RowButton>
          <RowButton
            words={`Remove part ${number}`}
            name="remove"
            off={alone}
            onClick={() => composing.remove(place)}
          >
            <TbX size={14} />
          </RowButton>
        </span>
      </div>
      {form !== undefined && form.boxes.length > 0 && (
        <div className={styles.boxes}>
          {form.boxes.map(({ name, words, unit, optional, choices }) =>
            choices === undefined ? (
              <ExpressionField
                key={name}
                words={words}
                unit={unit}
                whose={whose}
                optional={optional}
                value={part[name] as number | string | undefined}
                place={`${key}.${name}`}
                messageId={messageId}
                onChange={(value) => set(name, value)}
              />
            ) : (
              <NativeSelect
                key={name}
                size="xs"
                label={words}
                aria-label={`${words} ${whose}`}
                data={optional ? [{ value: "", label: "unchanged" }, ...choices] : [...choices]}
                value={String(part[name] ?? (optional ? "" : choices[0]))}
                onChange={(event) => set(name, event.currentTarget.value || undefined)}
              />
            ),
          )}
        </div>
      )}
      <RowRefusal
        at={key}
        inner={innerOf(part).map(([inner]) => `${key}.${inner.join(".")}`)}
        id={messageId}
        said={said}
      />
      {innerOf(part).map(([inner, parts]) => (
        <PartList key={inner.join(".")} place={[...place, ...inner]} parts={parts} composing={composing} />
      ))}
    </li>
  );
}

interface RowRefusalProps {
  readonly at: string;
  /** Where its inner parts are, which say for themselves what is refused in them. */
  readonly inner: readonly string[];
  readonly id: string;
  readonly said: string | null;
}

/** Below the row, as the boxes are too narrow for a sentence. */
function RowRefusal({ at, inner, id, said }: RowRefusalProps) {
  const within = useRefusedWithin(at, inner);
  const text = said ?? within;
  return text === null ? null : (
    <div id={id} role="alert" className={styles.refused}>
      {text}
    </div>
  );
}

interface RowButtonProps {
  readonly words: string;
  readonly name: string;
  readonly off?: boolean;
  readonly children: React.ReactNode;
  onClick(): void;
}

function RowButton({ words, name, off = false, children, onClick }: RowButtonProps) {
  return (
    <ActionIcon
      size={24}
      variant="subtle"
      color="gray"
      aria-label={words}
      title={words}
      data-button={name}
      aria-disabled={off}
      data-disabled={off || undefined}
      onClick={() => !off && onClick()}
    >
      {children}
    </ActionIcon>
  );
}
