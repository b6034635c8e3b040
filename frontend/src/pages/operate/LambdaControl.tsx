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

/** Control of one λ: slider with its safe range, box, buttons, and the preview at the edited value. */

const STEP_S = 0.01;
const DECIMALS = 3;
/** Start of the slider's scale [s], so that the range that is not offered is visible. */
const SCALE_FROM_S = 0.2;
/** Step of the slider. Its scale is logarithmic, because most values are near its lower end. */
const SLIDER_STEP = 0.01;

interface LambdaControlProps {
  readonly name: "lam_q" | "lam_S";
  readonly symbol: string;
  readonly hue: string;
  readonly tuning: Tuning;
  /** Value before an edit: active or staged. */
  readonly value: number;
  readonly loop: LoopName;
  readonly previewed: Previewed;
  /** Preview of the active tuning. */
  readonly present: TuningPreview | undefined;
  readonly compare: boolean;
  /** No change of the tuning is accepted now. */
  readonly disabled: boolean;
  onDraft(value: number | undefined): void;
  /** Sends or stages the value. */
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

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft changes the preview
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
              // a staged value may be below a range that has changed since; the thumb then stops at the minimum
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

/** Control of the disturbance rejection by feed-forward, with the forecast of a push. */

/** Default gain. Above it, M_s in contact with a stiff obstacle exceeds 1/(1 − 0.7). */
const DEFAULT_GAIN = 0.7;
const STEP = 0.1;
/** Force shown until a forecast is available [N]. */
const PUSH_N = 5;
const SHARE_DECIMALS = 2;

interface DisturbanceFeedforwardControlProps {
  readonly tuning: Tuning;
  readonly previewed: Previewed;
  /** No change of the tuning is accepted now. */
  readonly disabled: boolean;
  /** Reports an edited gain that is not active yet, for the forecast. */
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

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft changes the forecast
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
          onChange={(event) => sent.commit(event.currentTarget.checked ? DEFAULT_GAIN : 0)}
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
 * Forecast of a constant push: deflection, and return time and apparent stiffness without → with rejection.
 * Apparent stiffness is force over deflection; the rejection does not change the joint stiffness S.
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
