import { Button, Checkbox, Switch } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Fragment, useMemo, useState } from "react";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { NumberField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { MotorMargins, UndoTuning } from "../../components/TuningParts";
import { SignalName, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed, notANumber } from "../../samples/format";
import { type AngleUnit, formatWithUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { banksQuery } from "../../service/api/banks";
import { useAngleUnit } from "../../service/api/preferences";
import {
  type LambdaName,
  ON_TRIAL,
  type Previewed,
  type Staging,
  savedTuningQuery,
  useEndTrial,
  usePreview,
  usePreviewedStiffness,
  useSaveTuning,
  useSetTuning,
  useStagedTuning,
  useTryTuning,
  useTuningStep,
  whyNoRejection,
} from "../../service/api/tuning";
import { useWhyNoControl, useWhyNoRetuning } from "../../service/control/control";
import { isNumberOrText, useDraft } from "../../service/forms/drafts";
import { lastRefusal, RefusedFields } from "../../service/forms/refusals";
import { fieldEntry, symbolEntries } from "../../service/glossary";
import { HUES } from "../../theme/signals";
import type { PreviewedStep, SavedTuning, Trial, Tuning, TuningPreview } from "../../wire/types";
import { DisturbanceFeedforwardControl, LambdaControl } from "./LambdaControl";
import operateStyles from "./Operate.module.css";
import type { PlaneEntry } from "./operatingMap";
import tuningChangesStyles from "./TuningChanges.module.css";
import { TEXTS } from "./texts";

/** Table of the saved, active and staged tuning; staged λ can be applied, tried or discarded. */

/** Fields that identify a tuning. The bank is not among them: each bank has its own saved tuning. */
const PARTS = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
  ["lam_motor", "λ_motor"],
  ["b", "b"],
  ["interpolate", "scheduling"],
  ["motion", "motion"],
  ["u_plan", "U_plan"],
  ["k_ext", "k_ext"],
] as const;
/** Fields that have a name instead of a symbol. */
const NAMES: Readonly<Record<string, string>> = {
  interpolate: TEXTS.scheduling,
  motion: TEXTS.motionRow,
};
const DECIMALS = 3;
const DECIMALS_OF_MOTOR = 4;
const TRIAL_S = 10;

interface TuningChangesProps {
  readonly tuning: Tuning;
  readonly staged: Staging;
  /** Reason why the tuning cannot be changed now; null if it can. */
  readonly locked: string | null;
}

export function TuningChanges({ tuning, staged, locked }: TuningChangesProps) {
  const angles = useAngleUnit();
  const trial = useLive((live) => live.state?.trial ?? null);
  const { data: saved, error: unread } = useQuery(savedTuningQuery(tuning.bank?.id ?? null));
  const set = useSetTuning();
  const save = useSaveTuning();
  const tryOut = useTryTuning();
  const end = useEndTrial();
  const undo = useTuningStep("undo");
  const redo = useTuningStep("redo");
  const noControl = useWhyNoControl();
  const length = useDraft<number | string>("length of a trial", TRIAL_S, isNumberOrText);
  const seconds = length.value;
  const unlearned = useLive((live) => whyNoRejection(live.state, saved?.k_ext));
  const changed = saved !== undefined && PARTS.some(([name]) => saved[name] !== tuning[name]);
  const something = Object.keys(staged.values).length > 0;
  const failure = lastRefusal(set, save, tryOut, end, undo, redo);
  const about = [...PARTS.map(([name]) => tuning[name]), seconds];
  const offersTrial = staged.staging && trial === null;
  const odd =
    offersTrial && typeof seconds !== "number"
      ? fillText(TEXTS.trialDurationProblem, { problem: notANumber(seconds) })
      : null;
  const busy = set.isPending || save.isPending || tryOut.isPending || end.isPending;

  return (
    <section className={tuningChangesStyles.changes} aria-label={TEXTS.tuningChanges}>
      <table className={tuningChangesStyles.table} aria-label={TEXTS.tuningTable}>
        <thead>
          <tr>
            <th scope="col">{TEXTS.setting}</th>
            <th scope="col">{TEXTS.saved}</th>
            <th scope="col">{TEXTS.active}</th>
            <th scope="col">{TEXTS.staged}</th>
          </tr>
        </thead>
        <tbody>
          {PARTS.map(([name, symbol]) => (
            <tr key={name}>
              <th scope="row">
                {NAMES[name] === undefined ? (
                  <SignalName name={symbol} />
                ) : (
                  <Explained of={symbolEntries(symbol)}>{NAMES[name]}</Explained>
                )}
              </th>
              <td>
                <ValueOrReason value={saved?.[name]} why={unread?.message ?? TEXTS.notLoaded}>
                  {(value) => inWords(name, value)}
                </ValueOrReason>
              </td>
              <td data-differs={saved !== undefined && saved[name] !== tuning[name]}>
                {inWords(name, tuning[name])}
              </td>
              <td data-differs={isStaged(name) && staged.values[name] !== undefined}>
                <ValueOrReason
                  value={isStaged(name) ? staged.values[name] : undefined}
                  why={isStaged(name) ? TEXTS.nothingStaged : TEXTS.cannotBeStaged}
                >
                  {(value) => inWords(name, value)}
                </ValueOrReason>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      <RefusedFields error={odd === null ? failure : null} about={about}>
        <div className={tuningChangesStyles.decide}>
          <div className={tuningChangesStyles.actions}>
            <Button
              variant="default"
              size="compact-xs"
              disabled={!changed || busy || locked !== null || unlearned !== null || trial !== null}
              title={trial === null ? (unlearned ?? origin(saved)) : ON_TRIAL}
              onClick={() =>
                saved && set.mutate(Object.fromEntries(PARTS.map(([name]) => [name, saved[name]])))
              }
            >
              {TEXTS.revert}
            </Button>
            <Button
              variant="default"
              size="compact-xs"
              disabled={!changed || busy || trial !== null}
              {...(trial === null ? {} : { title: ON_TRIAL })}
              onClick={() => save.mutate()}
            >
              {TEXTS.save}
            </Button>
            <UndoTuning undo={undo} redo={redo} size="compact-xs" />
            <Switch
              size="xs"
              label={TEXTS.stage}
              checked={staged.staging}
              disabled={trial !== null || something}
              {...(something ? { title: TEXTS.stagedFirst } : {})}
              onChange={(event) => staged.turn(event.currentTarget.checked)}
            />
          </div>
          {trial !== null && (
            <TrialRow
              trial={trial}
              tuning={tuning}
              locked={busy || noControl !== null}
              onEnd={(keep) => end.mutate(keep)}
            />
          )}
          {offersTrial && (
            <div className={tuningChangesStyles.actions}>
              <Button
                size="compact-xs"
                disabled={!something || busy || locked !== null}
                onClick={() => set.mutate(staged.values, { onSuccess: staged.discard })}
              >
                {TEXTS.apply}
              </Button>
              <Button
                variant="default"
                size="compact-xs"
                disabled={!something || busy || locked !== null || typeof seconds !== "number"}
                onClick={() =>
                  typeof seconds === "number" && tryOut.mutate({ ...staged.values, duration_s: seconds })
                }
              >
                {TEXTS.tryFor}
              </Button>
              <NumberField
                aria-label={TEXTS.trialDuration}
                entry={fieldEntry("tuning.duration_s", angles)}
                place="duration_s"
                messageId="refusal-of-tuning"
                size="xs"
                w={54}
                value={seconds}
                onChange={length.set}
                styles={{ input: { height: 22, minHeight: 22 } }}
              />
              <span>s</span>
              <Button variant="default" size="compact-xs" disabled={!something} onClick={staged.discard}>
                {TEXTS.discard}
              </Button>
            </div>
          )}
          <Refusal
            id="refusal-of-tuning"
            error={odd === null ? failure : null}
            about={about}
            text={odd ?? locked}
            forFields
          />
        </div>
      </RefusedFields>
    </section>
  );
}

interface TrialRowProps {
  readonly trial: Trial;
  readonly tuning: Tuning;
  /** Whether the trial cannot be ended from this page now. */
  readonly locked: boolean;
  onEnd(keep: boolean): void;
}

function TrialRow({ trial, tuning, locked, onEnd }: TrialRowProps) {
  const others = PARTS.filter(([name]) => !isStaged(name) && trial[name] !== tuning[name]);
  return (
    <div className={tuningChangesStyles.actions}>
      <output aria-label={TEXTS.trial} className={tuningChangesStyles.trial}>
        {fillText(TEXTS.trialReverts, {
          lam_q: fixed(trial.lam_q, DECIMALS),
          lam_S: fixed(trial.lam_S, DECIMALS),
          others: others.map(([name, symbol]) => `, ${symbol} ${inWords(name, trial[name])}`).join(""),
          time: fixed(Math.ceil(trial.remaining_s), 0),
        })}
      </output>
      <Button size="compact-xs" disabled={locked} onClick={() => onEnd(true)}>
        {TEXTS.keep}
      </Button>
      <Button variant="default" size="compact-xs" disabled={locked} onClick={() => onEnd(false)}>
        {TEXTS.revertNow}
      </Button>
    </div>
  );
}

function origin(saved: SavedTuning | undefined): string {
  if (saved?.who) return fillText(TEXTS.savedBy, { person: saved.who });
  return saved?.moved ? fillText(TEXTS.nothingSaved, { reason: saved.moved }) : TEXTS.defaults;
}

type Part = (typeof PARTS)[number][0];

function isStaged(name: Part): name is LambdaName {
  return name === "lam_q" || name === "lam_S";
}

function inWords(name: Part, value: number | boolean | string): string {
  if (typeof value === "string") return value;
  if (typeof value === "boolean") return value ? TEXTS.interpolated : TEXTS.switched;
  if (name === "u_plan") return `${fixed(value, 1)} V`;
  if (name === "k_ext") return value === 0 ? TEXTS.noRejection : fixed(value, 2);
  if (name === "b") return fixed(value, DECIMALS);
  return `${fixed(value, name === "lam_motor" ? DECIMALS_OF_MOTOR : DECIMALS)} s`;
}

/** Card of the tuning: λ of both outer loops, their previews, and the changes from the saved tuning. */

const LAMBDAS = [
  { name: "lam_q", symbol: "λ_q", hue: HUES.q, loop: "position", step: "q" },
  { name: "lam_S", symbol: "λ_S", hue: HUES.S, loop: "stiffness", step: "S" },
] as const;

export function TuningCard() {
  const tuning = useLive((live) => live.state?.tuning);
  const u_max = useLive((live) => live.state?.limits.u_max ?? 0);
  return (
    <Card title={TEXTS.tuning} aside={<ActiveBank tuning={tuning} />}>
      {tuning ? <Lambdas tuning={tuning} u_max={u_max} /> : <div className={operateStyles.reserveTuning} />}
    </Card>
  );
}

function Lambdas({ tuning, u_max }: { tuning: Tuning; u_max: number }) {
  const setTuning = useSetTuning();
  const locked = useWhyNoRetuning();
  const staged = useStagedTuning();
  const [compare, setCompare] = useState(false);
  const [drafts, setDrafts] = useState<{ [Name in LambdaName]?: number | undefined }>({});
  const wanted = (name: LambdaName) => staged.values[name] ?? tuning[name];
  const [shareDraft, setShareDraft] = useState<number>();
  const { motion, u_plan, k_ext } = tuning;
  const S = usePreviewedStiffness();
  const previewed = usePreview(
    {
      lam_q: drafts.lam_q ?? wanted("lam_q"),
      lam_S: drafts.lam_S ?? wanted("lam_S"),
      motion,
      u_plan,
      k_ext: shareDraft ?? k_ext,
      S,
      printed: compare,
    },
    tuning,
  );
  const present = usePreview(
    { lam_q: tuning.lam_q, lam_S: tuning.lam_S, motion, u_plan, k_ext, S, printed: false },
    tuning,
  );
  return (
    <>
      {LAMBDAS.map(({ name, symbol, hue, loop, step }) => (
        <Fragment key={name}>
          <LambdaControl
            name={name}
            symbol={symbol}
            hue={hue}
            tuning={tuning}
            value={wanted(name)}
            loop={loop}
            previewed={previewed}
            present={present.preview}
            compare={compare}
            disabled={locked !== null}
            onDraft={(value) => setDrafts((before) => ({ ...before, [name]: value }))}
            onCommit={async (value) => {
              if (staged.staging) staged.stage(name, value);
              else await setTuning.mutateAsync({ [name]: value });
            }}
          />
          <StepForecast of={step} previewed={previewed} u_max={u_max} />
        </Fragment>
      ))}
      <DisturbanceFeedforwardControl
        tuning={tuning}
        previewed={previewed}
        disabled={locked !== null}
        onDraft={setShareDraft}
        onCommit={(k_ext) => setTuning.mutateAsync({ k_ext })}
      />
      <MotorMargins
        className={operateStyles.margins}
        lam_motor={tuning.lam_motor}
        bank={tuning.bank?.id ?? null}
      />
      <Checkbox
        size="xs"
        label={TEXTS.compare}
        checked={compare}
        onChange={(event) => setCompare(event.currentTarget.checked)}
      />
      <TuningChanges tuning={tuning} staged={staged} locked={locked} />
    </>
  );
}

interface StepForecastProps {
  readonly of: "q" | "S";
  readonly previewed: Previewed;
  readonly u_max: number;
}

/** Forecast of a step of one reference: times, overshoot, peak voltage and least tension. */
function StepForecast({ of, previewed, u_max }: StepForecastProps) {
  const angles = useAngleUnit();
  const { preview, stale, missing } = previewed;
  const step = of === "q" ? preview?.step_q : preview?.step_S;
  const saturates = step !== undefined && step.u_peak_V >= u_max;
  return (
    <output
      className={operateStyles.forecast}
      aria-label={of === "q" ? TEXTS.forecastOfQ : TEXTS.forecastOfS}
      aria-busy={stale}
      data-stale={stale}
      data-warn={saturates}
    >
      {preview && step ? heading(of, preview, step, angles) : fillText(TEXTS.stepOf, { signal: of })}
      {preview?.motion === "time-optimal" ? TEXTS.timeOptimalStep : ""}
      {TEXTS.after90}{" "}
      <ValueOrReason value={step?.rise_s} why={step ? TEXTS.not90 : missing}>
        {(rise) => fixed(rise, 2)}
      </ValueOrReason>{" "}
      {TEXTS.within2}{" "}
      <ValueOrReason value={step?.settling_s} why={step ? TEXTS.notSettled : missing}>
        {(settling) => fixed(settling, 2)}
      </ValueOrReason>{" "}
      {TEXTS.overshoot}{" "}
      <ValueOrReason value={step?.overshoot_percent} why={missing}>
        {(overshoot) => fixed(overshoot, 1)}
      </ValueOrReason>{" "}
      {TEXTS.percent} <Explained of="quantity:u_peak_V">{TEXTS.peak}</Explained>{" "}
      <ValueOrReason value={step?.u_peak_V} why={missing}>
        {(u_peak) => fixed(u_peak, 1)}
      </ValueOrReason>{" "}
      {fillText(TEXTS.ofVolts, { voltage: fixed(u_max, 0) })}{" "}
      <Explained of="quantity:F_min_N">{TEXTS.tension}</Explained> ≥{" "}
      <ValueOrReason value={step?.F_min_N} why={missing}>
        {(F_min) => fixed(F_min, 1)}
      </ValueOrReason>{" "}
      N
    </output>
  );
}

function heading(of: "q" | "S", preview: TuningPreview, step: PreviewedStep, angles: AngleUnit): string {
  if (of === "S") {
    return fillText(TEXTS.stepOfS, { start: fixed(step.start, 1), end: fixed(step.end, 1) });
  }
  const size = step.end - step.start;
  const size_text =
    angles === "deg" ? `${fixed((180 * size) / Math.PI, 0)}°` : formatWithUnit(size, "rad", angles);
  return fillText(TEXTS.stepOfQ, { size: size_text, S: fixed(preview.S, 1) });
}

function ActiveBank({ tuning }: { tuning: Tuning | undefined }) {
  if (tuning === undefined) return null;
  const { bank, entry_name } = tuning;
  if (bank === null) return <span className={operateStyles.aside}>{TEXTS.geometricGains}</span>;
  return (
    <span className={operateStyles.aside}>
      {fillText(TEXTS.activeBank, { bank: bank.name, version: bank.version, entry: entry_name })}
    </span>
  );
}

/** Operating points of the active bank as points of the map. */

const NONE: readonly PlaneEntry[] = [];

export function useBankEntries(): readonly PlaneEntry[] {
  const bank = useLive((live) => live.state?.tuning.bank?.id);
  const { data } = useQuery(banksQuery);
  return useMemo(() => {
    const entries = data?.find(({ id }) => id === bank)?.entries;
    return entries?.map(({ S_nominal, q_nominal }) => ({ S: S_nominal, q: q_nominal })) ?? NONE;
  }, [data, bank]);
}
