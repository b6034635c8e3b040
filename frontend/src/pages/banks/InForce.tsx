/** What the gains in force come from, with the ways back: to geometry, and to before the last change. */

import { Button } from "@mantine/core";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { UndoTuning } from "../../components/UndoTuning";
import { useLive } from "../../live/react";
import { useGeometry, useUndo } from "../../service/commands";
import { whyNoRetuning } from "../../service/retuning";
import { tuningInWords } from "../../service/tuningWords";
import { useNoControl } from "../../service/useNoControl";
import type { Bank } from "../../wire/types";
import { tuningOf } from "../experiments/order";
import page from "../Page.module.css";

export function InForce({ banks }: { banks: readonly Bank[] }) {
  const state = useLive((live) => live.state);
  const geometry = useGeometry();
  const undo = useUndo();
  const noControl = useNoControl();
  if (state === null) return null;
  const { bank, entry_name } = state.tuning;
  const own = tuningOf(state);
  const locked = whyNoRetuning(state, noControl);
  return (
    <div className={page.fields} style={{ padding: "4px 4px 8px" }}>
      <output aria-label="In force">
        {state.own_tuning ? "In force again after the run" : "In force"}: {tuningInWords(own, banks)}
        {bank !== null && !state.own_tuning && ` (now ${entry_name})`}
      </output>
      <OperatorsOnly>
        <div className={page.actions}>
          <Button
            variant="default"
            disabled={own.bank === 0 || locked !== null}
            title={
              own.bank === 0
                ? "The gains come from geometry already"
                : (locked ?? "Gains from geometry, no bank")
            }
            loading={geometry.isPending}
            onClick={() => geometry.mutate()}
          >
            Back to geometry
          </Button>
          <UndoTuning undo={undo} />
        </div>
      </OperatorsOnly>
      <Refusal error={geometry.error ?? undo.error} about={own} text={noControl} />
    </div>
  );
}
