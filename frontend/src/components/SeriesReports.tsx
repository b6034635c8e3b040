/** One report of several runs, in their order. */

import { Button } from "@mantine/core";

export function SeriesReports({ runs }: { runs: readonly number[] }) {
  const address = (format: "html" | "pdf") =>
    `./api/run-comparison/report.${format}?${runs.map((run) => `run=${run}`).join("&")}`;
  return (
    <>
      <Button
        component="a"
        href={address("html")}
        target="_blank"
        rel="noreferrer"
        variant="default"
        size="xs"
      >
        Report (HTML)
      </Button>
      <Button component="a" href={address("pdf")} download variant="default" size="xs">
        Report (PDF)
      </Button>
    </>
  );
}
