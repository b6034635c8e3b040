import { ActionIcon, Slider, Switch } from "@mantine/core";
import { type ReactNode, useEffect, useState } from "react";
import { TbMinus, TbPlus, TbRestore } from "react-icons/tb";
import { Refusal } from "../../components/Refusal";
import { TargetKeys, TouchLock } from "../../components/sliders";
import { ValueBox } from "../../components/ValueBox";
import { SignalName, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { angleWithUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { type Previewed, whyNoEstimate } from "../../service/api/tuning";
import { useSentValue } from "../../service/forms/drafts";
import { useErrorLifetime } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import { LAMBDAS } from "../../wire/sample.gen";
import type { Pushed, Tuning, TuningPreview } from "../../wire/types";
import operateStyles from "./Operate.module.css";
import { type LoopName, StepPreview } from "./StepPreview";
import { TEXTS } from "./texts";

/** One λ: slider with its safe range, box, − / + / reset, and the preview of the loop at the value in hand. */

const STEP_S = 0.01;
const DECIMALS = 3;
/** Where the scale begins, so that the range that is not offered stays in sight [s]. */
const SCALE_FROM_S = 0.2;
/** One step of the slider: the scale is logarithmic, for most of the work is done at its short end. */
const SLIDER_STEP = 0.01;

interface LambdaControlProps {
  readonly name: "lam_q" | "lam_S";
  readonly symbol: string;
  readonly hue: string;
  readonly tuning: Tuning;
  /** What the control starts from: in force, or staged. */
  readonly value: number;
  readonly loop: LoopName;
  readonly previewed: Previewed;
  /** Of what is in force. */
  readonly present: TuningPreview | undefined;
  readonly compare: boolean;
  /** A run has the tuning: nothing of it is taken. */
  readonly disabled: boolean;
  onDraft(value: number | undefined): void;
  /** Sends the value, or stages it. */
  onCommit(value: number): Promise<unknown>;
}

export function LambdaControl(props: LambdaControlProps) {
  const { name, symbol, hue, tuning, value, loop, previewed, present, compare, disabled, onDraft, onCommit } =
    props;
  const sent = useSentValue(value, onCommit);
  const min = tuning[`${name}_min`];
  const max = tuning[`${name}_max`];
  const [problem, setProblem] = useState<string | null>(null);
  const [proposed, setProposed] = useState(false);
  const target = proposed ? fillText(TEXTS.lambdaNotSent, { value: fixed(sent.value, DECIMALS) }) : null;
  const refusal = problem === null && target === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, value) !== null;
  const drafted = sent.editing ? sent.value : undefined;

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft is news to the preview
  useEffect(() => onDraft(drafted), [drafted]);

  const angles = useAngleUnit();
  const nudge = (by: number) => sent.commit(rounded(sent.value + by));
  const unsafe = (100 * Math.log(min / SCALE_FROM_S)) / Math.log(max / SCALE_FROM_S);
  const fromSlider = (position: number) => Math.min(Math.max(rounded(Math.exp(position)), min), max);

  return (
    <div className={operateStyles.control}>
      <div className={operateStyles.row}>
        <span className={operateStyles.name}>
          <SignalName name={symbol} />
        </span>
        <span className={operateStyles.bounds} />
        <Small name={fillText(TEXTS.decrease, { symbol })} disabled={disabled} onClick={() => nudge(-STEP_S)}>
          <TbMinus size={14} />
        </Small>
        <ValueBox
          label={fillText(TEXTS.lambdaBox, { symbol })}
          unit="s"
          value={sent.value}
          decimals={DECIMALS}
          step={STEP_S}
          width={84}
          disabled={disabled}
          onCommit={sent.commit}
          onProblem={setProblem}
          messageId={`refusal-of-${name}`}
          entry={fieldEntry(`tuning.${name}`, angles, { minimum: min, maximum: max })}
          refused={refused}
        />
        <Small name={fillText(TEXTS.increase, { symbol })} disabled={disabled} onClick={() => nudge(STEP_S)}>
          <TbPlus size={14} />
        </Small>
        <Small
          name={fillText(TEXTS.reset, { symbol })}
          disabled={disabled}
          title={fillText(TEXTS.resetTo, { time: LAMBDAS[name] })}
          onClick={() => sent.commit(Math.max(LAMBDAS[name], min))}
        >
          <TbRestore size={14} />
        </Small>
      </div>
      <TouchLock name={symbol}>
        <div className={operateStyles.lambdaSlider} style={{ ["--unsafe" as string]: `${unsafe}%` }}>
          <TargetKeys
            min={min}
            max={max}
            step={STEP_S}
            value={sent.value}
            proposed={proposed}
            onPropose={(value) => {
              setProposed(true);
              sent.edit(rounded(value));
            }}
            onCommand={() => {
              setProposed(false);
              sent.commit(Math.min(Math.max(sent.value, min), max));
            }}
            onLeave={() => {
              setProposed(false);
              sent.cancel();
            }}
          >
            <Slider
              thumbLabel={symbol}
              // the value itself: one that was staged may lie below a range that has moved since, where the thumb ends
              thumbValueText={`${fixed(sent.value, DECIMALS)} s`}
              size="sm"
              disabled={disabled}
              domain={[Math.log(SCALE_FROM_S), Math.log(max)]}
              min={Math.log(min)}
              max={Math.log(max)}
              step={SLIDER_STEP}
              precision={4}
              scale={Math.exp}
              value={Math.log(sent.value)}
              label={null}
              onChange={(position) => sent.edit(fromSlider(position))}
              onChangeEnd={(position) => {
                setProposed(false);
                sent.commit(fromSlider(position));
              }}
            />
          </TargetKeys>
          <div className={operateStyles.scale} aria-hidden="true">
            <span style={{ left: `${unsafe}%` }}>{fixed(min, DECIMALS)}</span>
            <span style={{ left: "100%" }}>{fixed(max, 0)} s</span>
          </div>
        </div>
      </TouchLock>
      <StepPreview
        symbol={symbol}
        hue={hue}
        loop={loop}
        preview={previewed.preview}
        stale={previewed.stale}
        missing={previewed.missing}
        present={present}
        drafted={sent.value !== tuning[name]}
        compare={compare}
      />
      <Refusal id={`refusal-of-${name}`} error={refusal} about={value} text={problem ?? target} />
    </div>
  );
}

interface SmallProps {
  readonly name: string;
  readonly title?: string;
  readonly disabled: boolean;
  readonly children: ReactNode;
  onClick(): void;
}

function Small({ name, title, disabled, children, onClick }: SmallProps) {
  return (
    <ActionIcon
      variant="default"
      size={30}
      aria-label={name}
      title={title ?? name}
      disabled={disabled}
      onClick={onClick}
    >
      {children}
    </ActionIcon>
  );
}

function rounded(seconds: number): number {
  return Number(seconds.toFixed(DECIMALS));
}

/** Pushes that are rejected by feed-forward of the outside force, and what that does to a joint that is pushed. */

/** As far as the margin against something stiff allows: beyond, M_s is more than 1/(1 − 0.7) there. */
const USUAL = 0.7;
const STEP = 0.1;
/** The push that is forecast, as long as no forecast says so. */
const PUSH_N = 5;
const SHARE_DECIMALS = 2;

interface DisturbanceFeedforwardControlProps {
  readonly tuning: Tuning;
  readonly previewed: Previewed;
  /** A run has the tuning: nothing of it is taken. */
  readonly disabled: boolean;
  /** What is in hand and not in force yet, for the forecast. */
  onDraft(k_ext: number | undefined): void;
  onCommit(k_ext: number): Promise<unknown>;
}

export function DisturbanceFeedforwardControl(props: DisturbanceFeedforwardControlProps) {
  const { tuning, previewed, disabled, onDraft, onCommit } = props;
  const { k_ext } = tuning;
  const reason = useLive((live) => whyNoEstimate(live.state));
  const sent = useSentValue(k_ext, onCommit);
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? sent.refusal : null;
  const refused = useErrorLifetime(refusal, k_ext) !== null;
  const rejects = sent.value > 0;
  const angles = useAngleUnit();
  const [typed, setTyped] = useState<number>();
  const drafted = typed ?? (sent.value === k_ext ? undefined : sent.value);

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft is news to the forecast
  useEffect(() => onDraft(drafted), [drafted]);

  return (
    <div className={operateStyles.control}>
      <div className={operateStyles.row}>
        <Switch
          size="xs"
          label={TEXTS.rejection}
          checked={rejects}
          disabled={disabled || (reason !== null && !rejects)}
          title={rejects ? undefined : (reason ?? undefined)}
          onChange={(event) => sent.commit(event.currentTarget.checked ? USUAL : 0)}
        />
        <span className={operateStyles.bounds}>
          {rejects ? TEXTS.rejectionRange : (reason ?? TEXTS.rejectionOff)}
        </span>
        {rejects && (
          <ValueBox
            label={TEXTS.rejectionGain}
            unit="1"
            value={sent.value}
            decimals={SHARE_DECIMALS}
            step={STEP}
            width={84}
            disabled={disabled}
            onDraft={setTyped}
            onCommit={sent.commit}
            onProblem={setProblem}
            messageId="refusal-of-k_ext"
            entry={fieldEntry("tuning.k_ext", angles, { minimum: 0, maximum: 1 })}
            refused={refused}
          />
        )}
      </div>
      <Refusal id="refusal-of-k_ext" error={refusal} about={k_ext} text={problem} />
      <PushForecast previewed={previewed} />
    </div>
  );
}

/**
 * How far and how long a held push moves the joint, and how hard the joint feels; behind the arrows with the rejection.
 * The stiffness S of the springs is what it was: what one feels is force over deviation.
 */
function PushForecast({ previewed }: Pick<DisturbanceFeedforwardControlProps, "previewed">) {
  const angles = useAngleUnit();
  const { preview, stale, missing } = previewed;
  const forecast = preview?.pushed;
  const { without, rejected } = forecast ?? {};
  const both = (word: (push: Pushed["without"]) => string) =>
    without && (rejected ? `${word(without)} → ${word(rejected)}` : word(without));
  const figure = (word: (push: Pushed["without"]) => string) => (
    <ValueOrReason value={both(word)} why={missing}>
      {String}
    </ValueOrReason>
  );
  return (
    <output
      className={operateStyles.pushForecast}
      aria-label={TEXTS.pushForecast}
      aria-busy={stale}
      data-stale={stale}
    >
      {fillText(TEXTS.pushDeflection, { force: fixed(forecast?.F ?? PUSH_N, 0) })}{" "}
      <ValueOrReason value={without?.give} why={missing}>
        {(give) => angleWithUnit(give, 1, angles)}
      </ValueOrReason>
      {fillText(TEXTS.pushBack, {
        band: forecast ? angleWithUnit(forecast.near, 1, angles) : TEXTS.pushBand,
      })}{" "}
      {figure(({ back_s }) => (back_s === null ? TEXTS.never : `${fixed(back_s, 2)} s`))}
      {TEXTS.apparentStiffness} {figure(({ felt_slow }) => fixed(felt_slow, 1))} {TEXTS.atSlow}{" "}
      {figure(({ felt_fast }) => fixed(felt_fast, 1))} {TEXTS.atFast}
    </output>
  );
}
