/** Progress of a dry run, and a button that cancels it. */

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

function describeProgress(news: DryRunNews | undefined): string {
  if (!news?.under_way || news.doing === "starting") return TEXTS.waitingForSimulator;
  if (news.doing === "pretension") return TEXTS.applyingPretension;
  if (news.doing === "evaluation") return TEXTS.evaluating;
  return fillText(TEXTS.progress, {
    simulated: duration(news.played_s),
    total: duration(news.duration_s),
  });
}
