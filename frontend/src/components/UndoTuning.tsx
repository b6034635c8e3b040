/** One step back of what is in force, whatever part of it was changed; after that the same step forward. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import type { useUndo } from "../service/commands";
import { useNoControl } from "../service/control";
import { banksQuery } from "../service/queries";
import { tuningInWords, whyNoUndo } from "../service/tuning";

export function UndoTuning({ undo, size }: { undo: ReturnType<typeof useUndo>; size?: "compact-xs" }) {
  const earlier = useLive((live) => live.state?.earlier ?? null);
  const undone = useLive((live) => live.state?.undone ?? false);
  const noControl = useNoControl();
  const reason = useLive((live) => whyNoUndo(live.state, noControl));
  const { data: banks = [] } = useQuery(banksQuery);
  const words = earlier === null ? "" : tuningInWords({ ...earlier, bank: earlier.bank?.id ?? 0 }, banks);
  return (
    <Button
      variant="default"
      {...(size === undefined ? {} : { size })}
      disabled={reason !== null}
      loading={undo.isPending}
      title={reason ?? `${undone ? "Again" : "Back to"} ${words}`}
      onClick={() => undo.mutate()}
    >
      {undone ? "Redo change" : "Undo change"}
    </Button>
  );
}
