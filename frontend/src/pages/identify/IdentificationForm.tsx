import { Button, SegmentedControl } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, useEffect, useMemo } from "react";
import { useCanvas } from "../../charts/canvas";
import { Card } from "../../components/Card";
import { DraftMark } from "../../components/DraftMark";
import { ChoiceField, NumberField, TextField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { ValueOrReason } from "../../components/values";
import { useLive, useLiveStore } from "../../live/react";
import { capital, duration, fixed, notANumber, numberIn, significant } from "../../samples/format";
import {
  type AngleUnit,
  angleText,
  boxText,
  labelWith,
  localizeText,
  offeredDefault,
  rangeText,
  readingOf,
  withUnit,
} from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { banksQuery } from "../../service/api/banks";
import {
  identificationKindsQuery,
  predictionQuery,
  useStartIdentification,
} from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { describeTuning } from "../../service/api/tuning";
import { useWhyNoControl } from "../../service/control/control";
import { isPlainRecord, useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry, settingEntry } from "../../service/glossary";
import { DEGREES } from "../../theme/signals";
import type { IdentificationKind, IdentificationRequest, Prediction, Setting } from "../../wire/types";
import { tuningOf } from "../experiments/ExperimentForm";
import { NextMode } from "../operate/ModeCard";
import { paintPlane } from "../operate/operatingMap";
import { whyNoStart } from "../operate/ReferencesCard";
import { useBankEntries } from "../operate/TuningCard";
import pageStyles from "../Page.module.css";
import identifyStyles from "./Identify.module.css";
import { SpringTableForm } from "./SpringResult";
import { SETTING_LABELS, TEXTS } from "./texts";

type Kind = IdentificationRequest["kind"];
type Values = Record<string, number | string>;

interface Asked {
  /** Null while a value is not a number. */
  readonly request: IdentificationRequest | null;
  readonly problem: string | null;
  /** Place of the field with the problem. */
  readonly place?: string;
}

const MAX_TENSIONS = 8;

function labelOf({ name, meaning }: Setting): string {
  return SETTING_LABELS[name] ?? meaning;
}

/** Returns every setting, with the changed value or the default; the form shows and sends all of them. */
export function valuesOf(kind: IdentificationKind, changed: Values, angles: AngleUnit): Values {
  const values = kind.settings.map((setting) => [
    setting.name,
    changed[setting.name] ?? usualOf(setting, angles),
  ]);
  return Object.fromEntries(values);
}

/** Describes the source of the value of a setting. */
export function originOf(setting: Setting, changed: Values, angles: AngleUnit): string {
  const [value, usual] = [changed[setting.name], usualOf(setting, angles)];
  if (value === undefined || value === usual) return TEXTS.usesDefault;
  const shown = typeof usual === "number" ? boxText(usual, setting.unit, angles) : usual;
  return fillText(TEXTS.defaultIs, { value: shown });
}

function usualOf(setting: Setting, angles: AngleUnit): number | string {
  return setting.choices ? String(setting.default) : offeredDefault(Number(setting.default), setting, angles);
}

/** `tensions` is a list separated by commas; if it is empty, the tension of `values` applies. */
export function requestOf(kind: IdentificationKind, values: Values, tensions: string): Asked {
  const list = tensions.split(/[,;\s]+/).filter((word) => word !== "");
  // a list of tensions replaces the single one
  const used = Object.entries(values).filter(([name]) => list.length === 0 || name !== "tension_N");
  const chosen = kind.settings.filter((setting) => setting.choices).map((setting) => setting.name);
  const odd = used.find(([name, value]) => typeof value !== "number" && !chosen.includes(name));
  if (odd !== undefined) {
    const [place, value] = odd;
    const setting = kind.settings.find(({ name }) => name === place);
    const label = setting === undefined ? place : labelOf(setting);
    return {
      request: null,
      problem: fillText(TEXTS.notANumber, { label, problem: notANumber(String(value)) }),
      place,
    };
  }
  const numbers = list.map(numberIn).filter((number) => number !== null);
  const place = "tensions_N";
  const word = list.find((one) => numberIn(one) === null);
  if (word !== undefined) {
    const problem = fillText(TEXTS.tensionNotANumber, { problem: notANumber(word) });
    return { request: null, problem, place };
  }
  if (numbers.length > MAX_TENSIONS) {
    return { request: null, problem: fillText(TEXTS.tooManyTensions, { most: MAX_TENSIONS }), place };
  }
  const several = numbers.length > 0 ? { tensions_N: numbers } : {};
  return {
    request: { kind: kind.kind as Kind, ...Object.fromEntries(used), ...several } as IdentificationRequest,
    problem: null,
  };
}

const NOMINAL_TENSIONS_N = [10, 20, 30, 40];

/** Changed settings of a kind. */
interface Changes {
  readonly changed: Values;
  readonly tensions: string;
}

const NO_CHANGES: Changes = { changed: {}, tensions: "" };

interface FormProps {
  onStarted(run: number): void;
  onTable(id: number): void;
  /** Receives the prediction of the run in the form. */
  onForecast(forecast: Forecast): void;
}

/** Form of an identification: its kind and settings, its prediction, and its start. */
export function IdentificationForm({ onStarted, onTable, onForecast }: FormProps) {
  const kinds = useQuery(identificationKindsQuery);
  const { value: kind, set: setKind } = useDraft<Kind>("kind of identification", "actuator", isKind);
  const chosen = kinds.data?.find((entry) => entry.kind === kind);
  return (
    <Card title={TEXTS.newIdentification}>
      <div className={pageStyles.fields}>
        <SegmentedControl
          aria-label={TEXTS.kind}
          fullWidth
          value={kind}
          data={(kinds.data ?? []).map((entry) => ({ value: entry.kind, label: entry.title }))}
          onChange={(value) => setKind(value as Kind)}
        />
        <span className={pageStyles.dim}>{chosen?.description ?? kinds.error?.message ?? TEXTS.loading}</span>
        {chosen && <KindForm key={kind} kind={chosen} onStarted={onStarted} onForecast={onForecast} />}
        {kind === "spring" && <SpringTableForm onTable={onTable} />}
      </div>
    </Card>
  );
}

interface KindFormProps extends Pick<FormProps, "onStarted" | "onForecast"> {
  readonly kind: IdentificationKind;
}

function KindForm({ kind, onStarted, onForecast }: KindFormProps) {
  const angles = useAngleUnit();
  const draft = useDraft(`identification of ${kind.kind}`, NO_CHANGES, isChanges);
  const { changed, tensions } = draft.value;
  const state = useLive((live) => live.state);
  const { data: banks = [] } = useQuery(banksQuery);
  const tuning = tuningOf(state);
  const start = useStartIdentification();
  const noControl = useWhyNoControl();
  const values = useMemo(() => valuesOf(kind, changed, angles), [kind, changed, angles]);
  const asked = useMemo(
    () => requestOf(kind, values, kind.kind === "actuator" ? tensions : ""),
    [kind, values, tensions],
  );
  const [request] = useDebouncedValue(asked.request, 300);
  const [from] = useDebouncedValue(useStartState(), 300);
  const prediction = useQuery(predictionQuery(request, from));
  const leaves = prediction.data?.within_range === false ? TEXTS.leavesRange : null;
  const reason = asked.problem ?? whyNoStart(state, "identify", noControl) ?? leaves;

  const problem = asked.problem ?? prediction.error?.message;
  useEffect(
    () => onForecast({ prediction: prediction.data, problem }),
    [onForecast, prediction.data, problem],
  );

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason === null && asked.request !== null) {
      start.mutate(asked.request, { onSuccess: (started) => onStarted(started.id) });
    }
  }

  function set(name: string, value: number | string): void {
    draft.set((before) => ({ ...before, changed: { ...before.changed, [name]: value } }));
  }

  return (
    <RefusedFields error={start.error} foreseen={prediction.error} about={[changed, tensions]}>
      <form className={pageStyles.fields} aria-label={TEXTS.newIdentification} onSubmit={submit}>
        <DraftMark
          draft={draft}
          of={TEXTS.draftOf}
          words={TEXTS.changedSettings}
          back={TEXTS.defaultsRestored}
          onDiscard={draft.discard}
        />
        {kind.kind === "actuator" && (
          <TensionFields
            tension_N={values.tension_N ?? ""}
            tensions={tensions}
            problem={asked.place === "tensions_N" ? asked.problem : null}
            onTension={(value) => set("tension_N", value)}
            onTensions={(text) => draft.set((before) => ({ ...before, tensions: text }))}
          />
        )}
        <div className={identifyStyles.grid}>
          {kind.settings
            .filter((setting) => setting.name !== "tension_N")
            .map((setting) =>
              setting.choices ? (
                <ChoiceField
                  key={setting.name}
                  name={setting.name}
                  label={labelOf(setting)}
                  description={describe(setting, originOf(setting, changed, angles), angles)}
                  entry={settingEntry(setting, angles)}
                  data={[...setting.choices]}
                  value={String(values[setting.name] ?? "")}
                  onChange={(value) => set(setting.name, value)}
                />
              ) : (
                <NumberField
                  key={setting.name}
                  name={setting.name}
                  label={labelWith(labelOf(setting), setting.unit, angles)}
                  description={describe(setting, originOf(setting, changed, angles), angles)}
                  entry={settingEntry(setting, angles)}
                  unit={setting.unit}
                  value={values[setting.name] ?? ""}
                  onChange={(value) => set(setting.name, value)}
                />
              ),
            )}
        </div>
        {state !== null && (
          <span className={pageStyles.dim}>
            {fillText(TEXTS.currentSettings, { settings: describeTuning(tuning, banks) })}
          </span>
        )}
        <div className={pageStyles.decide}>
          <Button
            type="submit"
            size="sm"
            aria-disabled={reason !== null}
            data-disabled={reason !== null || undefined}
            loading={start.isPending}
          >
            {TEXTS.start}
          </Button>
          <Refusal error={start.error} about={[changed, tensions]} text={reason}>
            {asked.problem === null && <NextMode need="start" />}
          </Refusal>
        </div>
      </form>
    </RefusedFields>
  );
}

function isKind(value: unknown): value is Kind {
  return value === "actuator" || value === "motor" || value === "spring";
}

function isChanges(value: unknown): value is Changes {
  const { changed, tensions } = (value ?? {}) as Partial<Changes>;
  return isPlainRecord(changed) && typeof tensions === "string";
}

/** Returns the meaning of a setting, its range and the source of its value, for the text below its box. */
function describe({ meaning, minimum, maximum, unit }: Setting, origin: string, angles: AngleUnit): string {
  const range = minimum == null || maximum == null ? "" : rangeText(minimum, maximum, unit, angles);
  return [capital(meaning), range.replaceAll(" ", "\u00a0"), origin]
    .filter((part) => part !== "")
    .join(" · ");
}

/** Returns a key of the start state of a prediction, with the joint position to one degree. */
function useStartState(): string {
  const store = useLiveStore();
  return useLive(({ state }) => {
    // during a run, the next one starts from the end state of that run
    if (state === null || state.task !== null) return "";
    const { mode, pretension_done, tuning } = state;
    return [mode, pretension_done, tuning.lam_motor, fixed(store.window.newest("q") * DEGREES, 0)].join();
  });
}

interface TensionProps {
  readonly tension_N: number | string;
  readonly tensions: string;
  /** Reason why the text is no list of tensions. */
  readonly problem: string | null;
  onTension(value: number | string): void;
  onTensions(text: string): void;
}

/** Box of one tension, and a list of several for successive runs. */
function TensionFields({ tension_N, tensions, problem, onTension, onTensions }: TensionProps) {
  const angles = useAngleUnit();
  const inTurn = tensions.trim() !== "";
  return (
    <>
      <div className={identifyStyles.tension}>
        <NumberField
          name="tension_N"
          label={TEXTS.tension}
          entry={fieldEntry("identification.tension_N", angles)}
          value={tension_N}
          disabled={inTurn}
          onChange={onTension}
        />
        <Button.Group>
          {NOMINAL_TENSIONS_N.map((tension) => (
            <Button
              key={tension}
              variant={!inTurn && tension_N === tension ? "light" : "default"}
              aria-label={fillText(TEXTS.tensionButton, { tension: withUnit(String(tension), "N") })}
              aria-pressed={!inTurn && tension_N === tension}
              onClick={() => {
                onTensions("");
                onTension(tension);
              }}
              px={10}
              h={30}
            >
              {tension}
            </Button>
          ))}
        </Button.Group>
      </div>
      <div className={identifyStyles.tension}>
        <TextField
          name="tensions_N"
          label={TEXTS.tensionList}
          entry={fieldEntry("identification.tensions_N", angles)}
          placeholder={TEXTS.tensionListHint}
          value={tensions}
          problem={problem}
          onChange={onTensions}
        />
        <Button
          variant={inTurn ? "light" : "default"}
          aria-pressed={inTurn}
          h={30}
          onClick={() => onTensions(inTurn ? "" : NOMINAL_TENSIONS_N.join(", "))}
        >
          {TEXTS.allFour}
        </Button>
      </div>
    </>
  );
}

/** Shows the path of a run in the plane of position and stiffness, with the current state of the joint. */
function ForecastMap({ prediction }: { prediction: Prediction }) {
  const store = useLiveStore();
  const entries = useBankEntries();
  const angles = useAngleUnit();
  const drawing = useMemo(() => {
    const newest = (name: string) => store.window.newest(name).toFixed(2);
    return {
      signature: () => [newest("q"), newest("S"), store.snapshot().state === null].join(),
      paint: (surface: Parameters<typeof paintPlane>[0]) => {
        const limits = store.snapshot().state?.limits;
        if (limits) paintPlane(surface, limits, undefined, store.window, entries, null, angles, prediction);
      },
    };
  }, [store, entries, prediction, angles]);
  const canvas = useCanvas(drawing);
  const low = angleText(prediction.q_low, 1, angles);
  const high = angleText(prediction.q_high, 1, angles);
  return (
    <figure className={identifyStyles.map}>
      <canvas
        ref={canvas}
        role="img"
        aria-label={labelWith(fillText(TEXTS.pathWithin, { low, high }), "rad", angles)}
      />
      <figcaption className={pageStyles.dim}>
        {fillText(TEXTS.pathAndRange, { q: labelWith("q", "rad", angles) })}
      </figcaption>
    </figure>
  );
}

export interface Forecast {
  readonly prediction: Prediction | undefined;
  readonly problem: string | undefined;
}

/** Shows the predicted effects of a run on the rig. */
export function PredictionView({ prediction, problem }: Forecast) {
  const angles = useAngleUnit();
  const isRunning = useLive((live) => live.state?.task != null);
  if (isRunning) {
    return (
      <Card title={TEXTS.forecast}>
        <output className={identifyStyles.prediction} aria-label={TEXTS.forecastStatus}>
          <span className={pageStyles.dim}>{TEXTS.runInProgress}</span>
        </output>
      </Card>
    );
  }
  return (
    <Card title={TEXTS.forecast}>
      <output className={identifyStyles.prediction} aria-label={TEXTS.forecastStatus}>
        {problem !== undefined && <Verdict good={false}>{problem}</Verdict>}
        {problem === undefined && prediction === undefined && (
          <span className={pageStyles.dim}>{TEXTS.predicting}</span>
        )}
        {problem === undefined && prediction !== undefined && (
          <>
            <div className={identifyStyles.forecast}>
              <ForecastMap prediction={prediction} />
              <dl className={pageStyles.facts}>
                <dt>
                  {fillText(TEXTS.jointNow, {
                    joint: labelWith(TEXTS.joint, "rad", angles),
                    q: angleText(prediction.q_start, 1, angles),
                  })}
                </dt>
                <dd>
                  <strong>
                    {fillText(TEXTS.fromTo, {
                      low: angleText(prediction.q_low, 1, angles),
                      high: angleText(prediction.q_high, 1, angles),
                    })}
                  </strong>
                </dd>
                <dt>{TEXTS.tendons}</dt>
                <dd>
                  <strong>
                    {fillText(TEXTS.fromTo, {
                      low: prediction.F_low === 0 ? TEXTS.slack : fixed(prediction.F_low, 1),
                      high: fixed(prediction.F_high, 1),
                    })}
                  </strong>{" "}
                  N
                </dd>
                {prediction.figures.map((figure) => (
                  <Figure key={figure.name} {...figure} />
                ))}
                <dt>{TEXTS.totalDuration}</dt>
                <dd>{duration(prediction.duration_s)}</dd>
              </dl>
            </div>
            <Verdict good={prediction.enough_motion}>{localizeText(prediction.message, angles)}</Verdict>
          </>
        )}
      </output>
    </Card>
  );
}

function Figure({ label, value, unit }: Prediction["figures"][number]) {
  const { unit: read, factor } = readingOf(unit, useAngleUnit());
  const counts = unit === "encoder counts";
  return (
    <>
      <dt>{label}</dt>
      <dd>
        <strong>
          <ValueOrReason value={value} why={TEXTS.notPredictable}>
            {(some) => (counts ? fixed(some, 0) : significant(some * factor, 3))}
          </ValueOrReason>
        </strong>{" "}
        {read}
      </dd>
    </>
  );
}
