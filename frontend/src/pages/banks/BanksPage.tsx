import { Button, FileButton } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { TbUpload } from "react-icons/tb";
import { Link, useLocation, useParams } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { UndoTuning } from "../../components/TuningParts";
import { SignalName } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { banksQuery, useActivateGeometry, useImportBank } from "../../service/api/banks";
import {
  describeTuning,
  usePreview,
  usePreviewedStiffness,
  useTuningStep,
  whyNoRetuning,
} from "../../service/api/tuning";
import { useWhyNoControl } from "../../service/control/control";
import { RefusedFields, useDescribedBy, useRefusedInput } from "../../service/forms/refusals";
import { HUES } from "../../theme/signals";
import type { Bank, BankFile, Tuning } from "../../wire/types";
import { tuningOf } from "../experiments/ExperimentForm";
import { StepPreview } from "../operate/StepPreview";
import pageStyles from "../Page.module.css";
import { BankComparison } from "./BankComparison";
import { BankEntries } from "./BankEntries";
import { BankTable } from "./BankTable";
import defaultGainsCardStyles from "./DefaultGainsCard.module.css";
import { TEXTS } from "./texts";

const MESSAGE_ID = "refusal-of-bank-file";

/** Imports a bank from an exported file. */
export function BankImport() {
  const importBank = useImportBank();
  const [, go] = useLocation();
  const [problem, setProblem] = useState<string | null>(null);
  const error = problem === null ? importBank.error : null;

  async function read(file: File | null): Promise<void> {
    if (file === null) return;
    setProblem(null);
    try {
      const document = JSON.parse(await file.text()) as BankFile;
      importBank.mutate(document, { onSuccess: (bank) => go(`/banks/${bank.id}`) });
    } catch {
      setProblem(fillText(TEXTS.notJson, { file: file.name }));
    }
  }

  return (
    <RefusedFields error={error} only="file">
      <div className={pageStyles.actions}>
        <Refusal id={MESSAGE_ID} error={error} text={problem} forFields />
        <FileChoice reading={importBank.isPending} odd={problem !== null} onChange={read} />
      </div>
    </RefusedFields>
  );
}

interface FileChoiceProps {
  readonly reading: boolean;
  /** Whether the chosen file is no bank. */
  readonly odd: boolean;
  onChange(file: File | null): void;
}

function FileChoice({ reading, odd, onChange }: FileChoiceProps) {
  const { ref, said } = useRefusedInput<HTMLButtonElement>("file", MESSAGE_ID);
  useDescribedBy(ref, odd ? MESSAGE_ID : undefined);
  const refused = odd || said !== null;
  return (
    <FileButton accept="application/json,.json" onChange={onChange}>
      {(props) => (
        <Button
          {...props}
          ref={ref}
          variant="default"
          style={refused ? { borderColor: "var(--warn-text)", color: "var(--warn-text)" } : undefined}
          data-refused={refused}
          size="compact-sm"
          leftSection={<TbUpload size={14} />}
          loading={reading}
        >
          {TEXTS.importBank}
        </Button>
      )}
    </FileButton>
  );
}

/** Shows the source of the active gains, with buttons for geometric gains, undo and redo. */
export function ActiveGains({ banks }: { banks: readonly Bank[] }) {
  const state = useLive((live) => live.state);
  const geometry = useActivateGeometry();
  const undo = useTuningStep("undo");
  const redo = useTuningStep("redo");
  const noControl = useWhyNoControl();
  if (state === null) return null;
  const { bank, entry_name } = state.tuning;
  const own = tuningOf(state);
  const locked = whyNoRetuning(state, noControl);
  return (
    <div className={pageStyles.fields} style={{ padding: "4px 4px 8px" }}>
      <output aria-label={TEXTS.activeTuning}>
        {fillText(state.own_tuning ? TEXTS.activeAfterRun : TEXTS.active, {
          tuning: describeTuning(own, banks),
        })}
        {bank !== null && !state.own_tuning && fillText(TEXTS.activePoint, { point: entry_name })}
      </output>
      <OperatorsOnly>
        <div className={pageStyles.actions}>
          <Button
            variant="default"
            disabled={own.bank === 0 || locked !== null}
            title={own.bank === 0 ? TEXTS.geometricAlready : (locked ?? TEXTS.geometricHint)}
            loading={geometry.isPending}
            onClick={() => geometry.mutate()}
          >
            {TEXTS.useGeometric}
          </Button>
          <UndoTuning undo={undo} redo={redo} />
        </div>
      </OperatorsOnly>
      <Refusal error={geometry.error ?? undo.error ?? redo.error} about={own} text={noControl} />
    </div>
  );
}

const LOOPS = [
  { loop: "position", lam: "lam_q", symbol: "λ_q", hue: HUES.q },
  { loop: "stiffness", lam: "lam_S", symbol: "λ_S", hue: HUES.S },
] as const;

/** Shows the loops with geometric gains, and the steps to build a bank. */
export function DefaultGainsCard() {
  const tuning = useLive((live) => live.state?.tuning);
  return (
    <>
      {tuning !== undefined && tuning.bank === null && <FromGeometry tuning={tuning} />}
      <Card title={TEXTS.howToBuild}>
        <ol className={defaultGainsCardStyles.steps}>
          <li>
            <Link href="/operate">{TEXTS.applyPretension}</Link> {TEXTS.applyPretensionWhy}
          </li>
          <li>
            <Link href="/identify">{TEXTS.identify}</Link> {TEXTS.identifyWhy}
          </li>
          <li>{TEXTS.build}</li>
          <li>{TEXTS.activateStep}</li>
        </ol>
      </Card>
    </>
  );
}

function FromGeometry({ tuning }: { tuning: Tuning }) {
  const { lam_q, lam_S, motion, u_plan, k_ext } = tuning;
  const S = usePreviewedStiffness();
  const { preview, stale, missing } = usePreview(
    { lam_q, lam_S, motion, u_plan, k_ext, S, printed: false },
    tuning,
  );
  return (
    <Card title={TEXTS.geometricGains} aside={<span className={pageStyles.dim}>{TEXTS.predicted}</span>}>
      <div className={pageStyles.halves}>
        {LOOPS.map(({ loop, lam, symbol, hue }) => (
          <div key={loop} className={defaultGainsCardStyles.loop}>
            <SignalName name={symbol} /> = {fixed(tuning[lam], 3)} s
            <StepPreview
              symbol={symbol}
              hue={hue}
              loop={loop}
              preview={preview}
              stale={stale}
              missing={missing}
              present={undefined}
              drafted={false}
              compare={false}
            />
          </div>
        ))}
      </div>
      <p className={pageStyles.lead}>{TEXTS.geometricSource}</p>
    </Card>
  );
}

/** Page of banks: versions, operating points with gains and robustness, their sources, and the effect of a change. */

export default function BanksPage() {
  const { id } = useParams();
  const banks = useQuery(banksQuery);
  const all = banks.data ?? [];
  const selected = all.find((bank) => bank.id === Number(id)) ?? all.find((bank) => bank.active) ?? all[0];
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>{TEXTS.title}</h1>
      <Card
        title={TEXTS.versions}
        aside={
          <OperatorsOnly>
            <BankImport />
          </OperatorsOnly>
        }
      >
        <ActiveGains banks={all} />
        {banks.data === undefined ? (
          <p className={pageStyles.empty}>{banks.error?.message ?? TEXTS.loading}</p>
        ) : (
          <BankTable banks={all} selected={selected?.id} />
        )}
      </Card>
      {banks.data?.length === 0 && <DefaultGainsCard />}
      {selected && <BankEntries bank={selected} />}
      {selected && all.length > 1 && <BankComparison key={selected.id} bank={selected} all={all} />}
    </div>
  );
}
