/** How far a dry run is, and a button that ends it. */

import { Button, Progress } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { duration } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { dryRunProgressQuery } from "../../service/api/experiments";
import type { DryRunProgress as DryRunNews } from "../../wire/types";
import page from "../Page.module.css";
import { TEXTS } from "./texts";

export function DryRunProgress({ onCancel }: { onCancel: () => void }) {
  const { data } = useQuery(dryRunProgressQuery);
  const share = data === undefined || data.duration_s === 0 ? 0 : data.played_s / data.duration_s;
  return (
    <div className={page.actions}>
      <Progress
        value={100 * share}
        aria-label={TEXTS.dryRunProgress}
        size="sm"
        style={{ flex: 1, minWidth: 80 }}
      />
      <span className={page.dim}>{describeProgress(data)}</span>
      <Button size="compact-sm" variant="default" onClick={onCancel}>
        {TEXTS.cancelDryRun}
      </Button>
    </div>
  );
}

function describeProgress(told: DryRunNews | undefined): string {
  if (!told?.under_way || told.doing === "starting") return TEXTS.waitingForSimulator;
  if (told.doing === "pretension") return TEXTS.applyingPretension;
  if (told.doing === "evaluation") return TEXTS.evaluating;
  return fillText(TEXTS.progress, {
    simulated: duration(told.played_s),
    total: duration(told.duration_s),
  });
}
