import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import type { FormEvent } from "react";
import { OperatorsOnly } from "../../components/ControlMenu";
import { DraftMark } from "../../components/DraftMark";
import { ChoiceField, SettingField, type SettingValue } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { MotorMargins } from "../../components/TuningParts";
import { useLive } from "../../live/react";
import { capital, notANumber } from "../../samples/format";
import { type AngleUnit, boxText, formatWithUnit, offeredDefault } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { banksQuery } from "../../service/api/banks";
import {
  experimentKindsQuery,
  type useDryRun,
  useQueueCommand,
  useStartExperiment,
} from "../../service/api/experiments";
import { useAngleUnit } from "../../service/api/preferences";
import { describeBank, describeTuning } from "../../service/api/tuning";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import { isPlainRecord, useDraft } from "../../service/forms/drafts";
import { lastRefusal, RefusedFields } from "../../service/forms/refusals";
import { settingEntry } from "../../service/glossary";
import type { Bank, ExperimentKind, Setting, State } from "../../wire/types";
import { NextMode } from "../operate/ModeCard";
import { whyNoStart } from "../operate/ReferencesCard";
import pageStyles from "../Page.module.css";
import { DryRunProgress } from "./DryRunProgress";
import { TEXTS } from "./texts";

type Value = boolean | number | string;
type Values = Record<string, Value>;

/** Tuning parameters, the same for every kind. */
const TUNING = ["lam_q", "lam_S", "lam_motor", "b", "interpolate", "motion", "u_plan", "k_ext"] as const;
const OF_THE_LOOP = new Set<string>([...TUNING, "bank", "seed"]);

export function isOfTheLoop(setting: Setting): boolean {
  return OF_THE_LOOP.has(setting.name);
}

/** Whether a setting has more than one value: the seed of a running service is fixed. */
export function hasChoice({ minimum, maximum }: Setting): boolean {
  return minimum == null || maximum == null || minimum < maximum;
}

/** One setting of the form. */
interface Shown {
  readonly setting: Setting;
  readonly value: Value;
  /** Description of the source of the value. */
  readonly origin: string;
}

/**
 * Returns every setting of a kind: the value that a person changed, else that of the operator's tuning, else the default.
 * While a temporary tuning is active, the operator's tuning is the one that will be restored.
 */
function shownSettings(
  kind: ExperimentKind,
  state: State | null,
  changed: Values,
  angles: AngleUnit,
): Shown[] {
  const active = tuningOf(state);
  return kind.settings.map((setting) => {
    const tuned = active[setting.name];
    const start = tuned ?? offeredDefault(setting.default ?? "", setting, angles);
    const value = changed[setting.name] ?? start;
    const word = tuned === undefined ? TEXTS.byDefault : TEXTS.active;
    const origin =
      value === start
        ? word
        : fillText(TEXTS.changedFrom, { origin: word, value: describeValue(setting, start, angles) });
    return { setting: withRange(setting, state), value, origin };
  });
}

interface Order {
  /** Null while a number box contains other text. */
  readonly order: { readonly name: string; readonly settings: Values } | null;
  readonly problem: string | null;
}

/** Builds the request from the shown values. */
function orderOf(kind: ExperimentKind, shown: readonly Shown[]): Order {
  for (const { setting, value } of shown) {
    if (typeof setting.default === "number" && typeof value !== "number") {
      return {
        order: null,
        problem: fillText(TEXTS.settingProblem, {
          setting: sentence(setting.meaning),
          problem: notANumber(String(value)),
        }),
      };
    }
  }
  const settings = Object.fromEntries(shown.map(({ setting, value }) => [setting.name, value]));
  return { order: { name: kind.name, settings }, problem: null };
}

/** Describes the differences from the defaults of a kind, without the tuning: "joint position held: 11.5°". */
export function describeChanges(
  settings: Readonly<Record<string, unknown>>,
  kind: ExperimentKind,
  angles: AngleUnit,
): string {
  const parts = kind.settings
    .filter((setting) => !isOfTheLoop(setting))
    .filter((setting) => settings[setting.name] !== undefined && !isUsual(setting, settings[setting.name]))
    .map((setting) => {
      const { name, unit, meaning } = setting;
      const value = settings[name];
      const [words = ""] = meaning.split("; "); // the rest is an explanation
      return fillText(TEXTS.settingValue, {
        setting: words,
        value:
          typeof value === "number"
            ? formatWithUnit(value, unit, angles)
            : describeValue(setting, value as Value, angles),
      });
    });
  return parts.length === 0 ? TEXTS.defaultSettings : parts.join("; ");
}

/** Whether a value is the default, or the rounded default of the form. */
function isUsual(setting: Setting, value: unknown): boolean {
  return value === setting.default || value === offeredDefault(setting.default, setting, "deg");
}

/** Describes the differences of a tuning from the active one: "λ_q 0.8 s (active 0.5 s)"; "" without any. */
export function tuningChanges(
  settings: Readonly<Record<string, unknown>>,
  active: Values,
  kind: ExperimentKind,
  angles: AngleUnit,
): string {
  return kind.settings
    .filter(({ name }) => settings[name] !== undefined && active[name] !== undefined)
    .filter(({ name }) => settings[name] !== active[name])
    .filter(({ name }) => name !== "u_plan" || settings.motion === "time-optimal")
    .map((setting) => {
      const { name, symbol, unit } = setting;
      const words = (value: Value) =>
        typeof value === "number" && name !== "bank"
          ? formatWithUnit(value, unit, angles)
          : describeValue(setting, value, angles);
      return fillText(TEXTS.tuningChange, {
        symbol,
        value: words(settings[name] as Value),
        active: words(active[name] as Value),
      });
    })
    .join(", ");
}

/** Returns the choices of the gain source: geometry, and every bank. */
function bankChoices(banks: readonly Bank[]): { value: string; label: string }[] {
  return [0, ...banks.map(({ id }) => id)].map((id) => ({
    value: String(id),
    label: describeBank(id, banks),
  }));
}

/** Returns the operator's tuning as settings; empty before the first state. */
export function tuningOf(state: State | null): Values {
  if (state === null) return {};
  const tuning = state.own_tuning ?? state.tuning;
  const parts = TUNING.map((name) => [name, tuning[name]] as const);
  return { ...Object.fromEntries(parts), bank: tuning.bank?.id ?? 0 };
}

/** Tuning parameters whose range depends on the plant. */
const OF_THE_PLANT = ["lam_q", "lam_S", "lam_motor", "u_plan"] as const;

function withRange(setting: Setting, state: State | null): Setting {
  const name = OF_THE_PLANT.find((one) => one === setting.name);
  if (state === null || name === undefined) return setting;
  return { ...setting, minimum: state.tuning[`${name}_min`], maximum: state.tuning[`${name}_max`] };
}

function describeValue({ name, unit }: Setting, value: Value, angles: AngleUnit): string {
  if (name === "bank") return describeBank(value, []);
  if (typeof value === "boolean") return value ? TEXTS.yes : TEXTS.no;
  return typeof value === "number" ? boxText(value, unit, angles) : value;
}

function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

const NO_CHANGES: Values = {};

interface ExperimentFormProps {
  readonly kind: ExperimentKind;
  onStarted(id: number): void;
  /** Dry run of the page, which shows its result next to any open form. */
  readonly dryRun: ReturnType<typeof useDryRun>;
}

export function ExperimentForm({ kind, onStarted, dryRun }: ExperimentFormProps) {
  const draft = useDraft<Values>(`settings of ${kind.name}`, NO_CHANGES, isPlainRecord);
  const changed = draft.value;
  const state = useLive((live) => live.state);
  const { data: banks = [] } = useQuery(banksQuery);
  const start = useStartExperiment();
  const queue = useQueueCommand();
  const may = useMayCommand();
  const noControl = useWhyNoControl();
  const shown = shownSettings(kind, state, changed, useAngleUnit());
  const values = Object.fromEntries(shown.map(({ setting, value }) => [setting.name, value]));
  const asked = orderOf(kind, shown);
  const unknown = state === null ? TEXTS.tuningUnknown : null;
  const problem = unknown ?? asked.problem;
  const order = problem === null ? asked.order : null;
  const beyond = kind.why_not === "" ? null : fillText(TEXTS.whyNot, { reason: capital(kind.why_not) });
  const reason = problem ?? beyond ?? whyNoStart(state, "experiment", noControl);
  const attempts = dryRun.variables?.name === kind.name ? [start, queue, dryRun] : [start, queue];
  const failure = problem === null ? lastRefusal(...attempts) : null;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason !== null || order === null) return;
    start.mutate(order, { onSuccess: (started) => onStarted(started.id) });
  }

  const offered = shown.filter(({ setting }) => hasChoice(setting));
  const field = (one: Shown) => (
    <Field
      key={one.setting.name}
      shown={one}
      choices={one.setting.name === "bank" ? bankChoices(banks) : null}
      onChange={(value) => draft.set((before) => ({ ...before, [one.setting.name]: value }))}
    />
  );

  return (
    <RefusedFields error={failure} about={changed}>
      <form className={pageStyles.fields} aria-label={kind.title} onSubmit={submit}>
        <span className={pageStyles.dim}>{kind.description}</span>
        <DraftMark
          draft={draft}
          of={fillText(TEXTS.settingsOf, { experiment: kind.title.toLowerCase() })}
          words={TEXTS.changedSettings}
          back={TEXTS.discardSettings}
          onDiscard={draft.discard}
        />
        {offered.filter(({ setting }) => !isOfTheLoop(setting)).map(field)}
        <details>
          <summary>{fillText(TEXTS.loopSettings, { tuning: describeTuning(values, banks) })}</summary>
          <div className={pageStyles.fields} style={{ paddingTop: 8 }}>
            {offered.filter(({ setting }) => isOfTheLoop(setting)).map(field)}
            {state !== null && typeof values.lam_motor === "number" && (
              <MotorMargins
                className={pageStyles.dim}
                lam_motor={values.lam_motor}
                bank={state.tuning.bank?.id ?? null}
              />
            )}
            <span className={pageStyles.dim}>{TEXTS.tuningRestored}</span>
          </div>
        </details>
        <div className={pageStyles.decide}>
          <div className={pageStyles.actions}>
            <OperatorsOnly>
              <Button
                type="submit"
                size="sm"
                aria-label={fillText(TEXTS.startExperiment, { experiment: kind.title.toLowerCase() })}
                aria-disabled={reason !== null}
                data-disabled={reason !== null || undefined}
                loading={start.isPending}
              >
                {TEXTS.start}
              </Button>
              <Button
                size="sm"
                variant="default"
                disabled={order === null || beyond !== null}
                loading={queue.isPending}
                onClick={() => order && queue.mutate({ do: "add", ...order })}
              >
                {TEXTS.addToQueue}
              </Button>
            </OperatorsOnly>
            <Button
              size="sm"
              variant="default"
              disabled={order === null}
              loading={dryRun.isPending}
              title={TEXTS.dryRunHint}
              onClick={() => order && dryRun.mutate(order)}
            >
              {TEXTS.dryRun}
            </Button>
          </div>
          {dryRun.isPending && dryRun.variables?.name === kind.name && (
            <DryRunProgress onCancel={dryRun.cancel} />
          )}
          <Refusal error={failure} about={changed} text={may === false ? problem : reason}>
            {may !== false && problem === null && beyond === null && <NextMode need="start" />}
          </Refusal>
        </div>
      </form>
    </RefusedFields>
  );
}

interface FieldProps {
  readonly shown: Shown;
  /** Choices of the gain source; null for other settings. */
  readonly choices: readonly { value: string; label: string }[] | null;
  onChange(value: SettingValue): void;
}

function Field({ shown: { setting, value, origin }, choices, onChange }: FieldProps) {
  const angles = useAngleUnit();
  if (choices === null) {
    return <SettingField setting={setting} value={value} origin={origin} onChange={onChange} />;
  }
  const known = choices.some((choice) => choice.value === String(value));
  return (
    <ChoiceField
      name={setting.name}
      label={TEXTS.gainSource}
      description={origin}
      entry={settingEntry(setting, angles)}
      data={
        known
          ? [...choices]
          : [...choices, { value: String(value), label: fillText(TEXTS.bank, { bank: String(value) }) }]
      }
      value={String(value)}
      onChange={(id) => onChange(Number(id))}
    />
  );
}

interface RunSummaryProps {
  readonly name: string;
  readonly settings: Readonly<Record<string, unknown>>;
  /** Active tuning, with which the tuning of a queued experiment is compared. */
  readonly active?: Values;
}

/** Shows the settings and the tuning of an experiment, in two lines. */
export function RunSummary({ name, settings, active }: RunSummaryProps) {
  const angles = useAngleUnit();
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const { data: banks = [] } = useQuery(banksQuery);
  const kind = kinds.find((one) => one.name === name || one.name.startsWith(`${name}@`));
  const changes =
    kind === undefined || active === undefined ? "" : tuningChanges(settings, active, kind, angles);
  const tuning = describeTuning(settings, banks);
  return (
    <span className={pageStyles.dim}>
      {kind === undefined
        ? tuning
        : fillText(TEXTS.settingsAndTuning, { settings: describeChanges(settings, kind, angles), tuning })}
      {changes !== "" && fillText(TEXTS.unlikeActive, { changes })}
    </span>
  );
}
