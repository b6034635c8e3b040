import { Button, Loader } from "@mantine/core";
import type { FormEvent } from "react";
import type { IconType } from "react-icons";
import {
  TbAlertTriangle,
  TbArrowDownRight,
  TbArrowUpRight,
  TbCircle,
  TbCircleCheck,
  TbCircleX,
  TbPlayerPlay,
} from "react-icons/tb";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Explained } from "../../components/Explained";
import { NumberField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { LocalizedText, SignalName, ValueOrReason } from "../../components/values";
import { useLive, useLiveStore, useNow, useSampleAge } from "../../live/react";
import { age, capital, dateTime, duration, fixed, NOT_MEASURED, significant } from "../../samples/format";
import {
  type AngleUnit,
  angleText,
  labelWith,
  offeredDefault,
  rangeText,
  readingOf,
  withUnit,
} from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import type { SampleWindow } from "../../samples/window";
import { useAngleUnit } from "../../service/api/preferences";
import { useStepCommand } from "../../service/api/system";
import { isPlainRecord, useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { unitOf } from "../../theme/signals";
import { FIELDS, type SignalName as Signal } from "../../wire/sample.gen";
import type { BringUpResult, BringUpRunning, BringUpStep } from "../../wire/types";
import pageStyles from "../Page.module.css";
import bringUpStyles from "./BringUp.module.css";
import { TEXTS } from "./texts";

type StepId = BringUpStep["id"];

const ANGLES = ["q", "theta_A", "theta_B"] as const;
const FORCES = ["F_A", "F_B"] as const;
const VOLTAGES = ["u_A", "u_B"] as const;

/** Measured voltages, shown with the forces while these are being calibrated. */
const VOLTS = ["V_A", "V_B"] as const;

const SIGNALS: Readonly<Record<StepId, readonly Signal[]>> = {
  wiring_test: [...ANGLES, ...FORCES],
  tare: [...FORCES, ...VOLTS],
  calibrate: [...FORCES, ...VOLTS],
  zero: ANGLES,
  direction: [...ANGLES, ...FORCES, ...VOLTAGES],
  home: [...ANGLES, ...FORCES, ...VOLTAGES],
  pretension: [...FORCES, ...VOLTAGES],
  safety_module: [...FORCES, ...VOLTAGES],
};

/** Returns the signals that a step shows. */
export function signalsOf(step: StepId): readonly Signal[] {
  return SIGNALS[step];
}

type Movement = "rising" | "falling" | "still" | "unknown";

/** Smallest change within `OVER_S` that counts as a movement by unit: above the noise, below a movement by hand. */
const MOVES: Readonly<Record<string, number>> = { rad: 0.005, N: 0.5, V: 0.02 };
const OVER_S = 0.4;
/** Averaging time at both ends of that interval, which reduces the noise of a load cell tenfold. */
const AVERAGED_S = 0.1;

/** Returns the direction of a signal; "unknown" for too few samples or NaN. */
export function movement(window: SampleWindow, name: string, period_s: number): Movement {
  const span = Math.round(OVER_S / period_s);
  const part = Math.round(AVERAGED_S / period_s);
  const change =
    mean(window, name, window.endTick - part, part) - mean(window, name, window.endTick - span, part);
  if (Number.isNaN(change)) return "unknown";
  if (Math.abs(change) < (MOVES[unitOf(name)] ?? 0)) return "still";
  return change > 0 ? "rising" : "falling";
}

function mean(window: SampleWindow, name: string, from: number, count: number): number {
  let sum = 0;
  for (let tick = from; tick < from + count; tick++) sum += window.at(name, tick);
  return sum / count;
}

const DECIMALS: Readonly<Record<string, number>> = { V: 3 };
const USUAL = 2;
const UPDATE_MS = 100;

const WORDS: Record<Movement, string> = {
  rising: TEXTS.rising,
  falling: TEXTS.falling,
  still: TEXTS.still,
  unknown: "",
};

/** Shows the current values of the signals of a step, large enough to be read at the rig. */
function StepReadings({ step }: { step: BringUpStep["id"] }) {
  const store = useLiveStore();
  const angles = useAngleUnit();
  const names = signalsOf(step);
  const period_s = useLive((live) => live.layout?.period_s ?? 0.001);
  const old_s = useSampleAge();
  useNow(UPDATE_MS);
  return (
    <section className={bringUpStyles.readings} aria-label={TEXTS.readings} data-stale={old_s !== null}>
      <dl>
        {names.map((name, index) => {
          const unit = unitOf(name);
          const first = unit !== unitOf(names[index - 1] ?? "");
          const going = old_s === null ? movement(store.window, name, period_s) : "unknown";
          return (
            <div key={name} className={bringUpStyles.reading} data-movement={going} data-first={first}>
              <dt>
                <SignalName name={symbolOf(name)} />
              </dt>
              <dd>
                <ValueOrReason value={store.window.newest(name)} why={TEXTS.noReading}>
                  {(value) =>
                    unit === "rad" ? angleText(value, USUAL, angles) : fixed(value, DECIMALS[unit] ?? USUAL)
                  }
                </ValueOrReason>{" "}
                <small>{readingOf(unit, angles).unit}</small>
              </dd>
              <dd className={bringUpStyles.movement}>
                {going === "rising" && <TbArrowUpRight size={15} aria-hidden="true" />}
                {going === "falling" && <TbArrowDownRight size={15} aria-hidden="true" />}
                {WORDS[going]}
              </dd>
            </div>
          );
        })}
      </dl>
      {old_s !== null && (
        <p className={bringUpStyles.old}>{fillText(TEXTS.lastReading, { age: age(1000 * old_s) })}</p>
      )}
    </section>
  );
}

function symbolOf(name: string): string {
  return FIELDS.find((field) => field.name === name)?.symbol ?? name;
}

type StepStatus = BringUpStep["state"] | "running";

const STEP_STATUS: Record<StepStatus, { word: string; Icon: IconType }> = {
  never: { word: TEXTS.never, Icon: TbCircle },
  current: { word: TEXTS.current, Icon: TbCircleCheck },
  out_of_date: { word: TEXTS.outOfDate, Icon: TbAlertTriangle },
  failed: { word: TEXTS.failed, Icon: TbCircleX },
  running: { word: TEXTS.running, Icon: TbPlayerPlay },
};

/** Typed values of a step by name; text if a value is not a number. */
type Typed = Readonly<Record<string, number | string>>;

interface StepCardProps {
  readonly step: BringUpStep;
  readonly number: number;
  /** Whether the step is running, or the next one to do. */
  readonly open: boolean;
}

const NOTHING: Typed = {};

function isTyped(value: unknown): value is Typed {
  return isPlainRecord(value) && !Object.values(value).some((one) => typeof one === "boolean");
}

/** Shows one commissioning step: status, instruction, start, requests during the step, and result. */
export function StepCard({ step, number, open }: StepCardProps) {
  const { id, title, instruction, state, why, result, running } = step;
  // persists after the step, so that a repetition starts from the typed values
  const { value: changed, set: setChanged } = useDraft<Typed>(
    `numbers of bring-up step ${id}`,
    NOTHING,
    isTyped,
  );
  const status: StepStatus = running === null ? state : "running";
  const { word, Icon } = STEP_STATUS[status];
  return (
    <Card
      title={fillText(TEXTS.stepTitle, { number, title })}
      className={bringUpStyles.step}
      aside={
        <span className={bringUpStyles.status} data-standing={status}>
          <Icon size={17} aria-hidden="true" />
          <Explained of={`step:${state}`} quiet>
            {word}
          </Explained>
        </span>
      }
    >
      <div className={bringUpStyles.halves} data-open={open}>
        <div className={pageStyles.fields}>
          <p className={bringUpStyles.text}>
            <LocalizedText text={instruction} />
          </p>
          {why !== "" && state !== "never" && (
            <p className={bringUpStyles.why} data-standing={status}>
              <LocalizedText text={capital(why)} />
            </p>
          )}
          {running === null ? (
            <Start step={step} prominent={open} changed={changed} onChange={setChanged} />
          ) : (
            <UnderWay running={running} title={title} />
          )}
        </div>
        <div className={bringUpStyles.seen}>
          {open && <StepReadings step={id} />}
          {result !== null && <Result result={result} outdated={state === "out_of_date"} />}
        </div>
      </div>
    </Card>
  );
}

interface StartProps {
  readonly step: BringUpStep;
  readonly prominent: boolean;
  readonly changed: Typed;
  onChange(changed: Typed): void;
}

function Start({ step, prominent, changed, onChange }: StartProps) {
  const { id, title, inputs, blocked, state } = step;
  const word = state === "current" ? TEXTS.repeat : TEXTS.start;
  const angles = useAngleUnit();
  const command = useStepCommand();
  const values = Object.fromEntries(
    inputs.map((input) => [input.name, changed[input.name] ?? offeredDefault(input.default, input, angles)]),
  );
  const numbers = numbersIn(values);
  const reason = blocked !== "" ? capital(blocked) : numbers === null ? TEXTS.notANumber : null;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason === null && numbers !== null) command.mutate({ do: "start", step: id, values: numbers });
  }

  return (
    <RefusedFields error={command.error} about={changed}>
      <form className={pageStyles.fields} aria-label={title} onSubmit={submit}>
        {inputs.length > 0 && (
          <div className={bringUpStyles.inputs}>
            {inputs.map(({ name, words, unit, minimum, maximum }) => (
              <NumberField
                key={name}
                name={name}
                label={labelWith(capital(words), unit, angles)}
                unit={unit}
                description={rangeText(minimum, maximum, unit, angles)}
                value={values[name] ?? ""}
                onChange={(value) => onChange({ ...changed, [name]: value })}
              />
            ))}
          </div>
        )}
        <OperatorsOnly>
          <div className={pageStyles.actions}>
            <Button
              type="submit"
              size="sm"
              variant={prominent ? "filled" : "default"}
              aria-label={fillText(TEXTS.startStep, { action: word, step: title.toLowerCase() })}
              aria-disabled={reason !== null}
              data-disabled={reason !== null || undefined}
              loading={command.isPending}
            >
              {word}
            </Button>
          </div>
        </OperatorsOnly>
        <Refusal error={command.error} about={[changed, blocked]} text={reason} />
      </form>
    </RefusedFields>
  );
}

/** Returns the values as numbers; null if one of them is not a number. */
function numbersIn(values: Record<string, number | string>): Record<string, number> | null {
  const all = Object.entries(values);
  return all.every((entry): entry is [string, number] => typeof entry[1] === "number")
    ? Object.fromEntries(all as [string, number][])
    : null;
}

/** Shows a running step. Its buttons do not move on a request, so that a click on Cancel never reaches Confirm. */
function UnderWay({ running, title }: { running: BringUpRunning; title: string }) {
  const { phase, elapsed_s, confirm } = running;
  const command = useStepCommand();
  const asked = confirm !== "";
  const virtual = useLive((live) => live.state?.plant.kind === "virtual_card");
  return (
    // biome-ignore lint/a11y/useSemanticElements: the buttons act at once and form no fieldset
    <div
      className={bringUpStyles.running}
      role="group"
      aria-label={fillText(TEXTS.stepRunning, { step: title })}
    >
      <div className={bringUpStyles.phase}>
        {!asked && <Loader size={14} aria-hidden="true" />}
        <output aria-label={TEXTS.progress}>
          <LocalizedText text={capital(phase)} />
        </output>
        <span className={pageStyles.dim}>{duration(elapsed_s)}</span>
      </div>
      <output aria-label={TEXTS.whatToDo} className={bringUpStyles.asked} data-asked={asked}>
        {asked && <LocalizedText text={confirm} />}
        {asked && virtual && <span className={pageStyles.dim}> {TEXTS.confirmSimulates}</span>}
      </output>
      <OperatorsOnly>
        <div className={pageStyles.actions}>
          <Button
            size="sm"
            aria-disabled={!asked}
            data-disabled={!asked || undefined}
            loading={command.isPending && command.variables.do === "confirm"}
            onClick={() => asked && command.mutate({ do: "confirm" })}
          >
            {TEXTS.confirm}
          </Button>
          <Button
            size="sm"
            variant="default"
            loading={command.isPending && command.variables.do === "cancel"}
            onClick={() => command.mutate({ do: "cancel" })}
          >
            {TEXTS.cancel}
          </Button>
        </div>
      </OperatorsOnly>
      <Refusal error={command.error} about={[phase, confirm]} />
    </div>
  );
}

function Result({ result, outdated }: { result: BringUpResult; outdated: boolean }) {
  const angles = useAngleUnit();
  const { passed, text, figures, who, at } = result;
  return (
    <section className={bringUpStyles.result} aria-label={TEXTS.result} data-outdated={outdated}>
      <Verdict good={passed}>{capital(text)}</Verdict>
      {figures.length > 0 && (
        <dl className={pageStyles.facts}>
          {figures.map(({ words, value, unit }) => (
            <div key={words} className={bringUpStyles.figure}>
              <dt>{words}</dt>
              <dd>
                <ValueOrReason value={value} why={NOT_MEASURED}>
                  {(number) => figure(number, unit, angles)}
                </ValueOrReason>
              </dd>
            </div>
          ))}
        </dl>
      )}
      <span className={pageStyles.dim}>
        {fillText(TEXTS.personAndTime, { person: who, time: dateTime(at) })}
      </span>
    </section>
  );
}

const DIGITS = 4;

function figure(value: number, unit: string, angles: AngleUnit): string {
  const { unit: read, factor } = readingOf(unit, angles);
  const number = significant(value * factor, DIGITS);
  return withUnit(number, read);
}
