import { Button, Checkbox } from "@mantine/core";
import { useState } from "react";
import { TbDownload, TbExternalLink } from "react-icons/tb";
import { fillText } from "../samples/texts";
import { useFormulas } from "../service/api/formulas";
import { TEXTS } from "./texts";

/** Downloads of a run: reports, data and bundle. */

const DATA = [
  { format: "csv", label: TEXTS.dataCsv },
  { format: "parquet", label: TEXTS.dataParquet },
  { format: "mat", label: TEXTS.dataMat },
  { format: "mcap", label: TEXTS.dataMcap },
] as const;

export function Downloads({ run, report }: { run: number; report: boolean }) {
  const formulas = useFormulas();
  const [isIncluded, setIncluded] = useState(false);
  const names = formulas.map(({ name }) => name).join(",");
  const query = isIncluded && names !== "" ? `?formulas=${names}` : "";
  return (
    <>
      {report && (
        <>
          <Button
            component="a"
            href={`./api/runs/${run}/report.html`}
            target="_blank"
            rel="noreferrer"
            variant="default"
            leftSection={<TbExternalLink size={14} />}
          >
            {TEXTS.reportHtml}
          </Button>
          <Button
            component="a"
            href={`./api/runs/${run}/report.pdf`}
            download
            variant="default"
            leftSection={<TbDownload size={14} />}
          >
            {TEXTS.reportPdf}
          </Button>
        </>
      )}
      {DATA.map(({ format, label }) => (
        <Button
          key={format}
          component="a"
          href={`./api/runs/${run}/data.${format}${query}`}
          download
          variant="default"
          leftSection={<TbDownload size={14} />}
        >
          {label}
        </Button>
      ))}
      {formulas.length > 0 && (
        <Checkbox
          label={TEXTS.withFormulas}
          title={fillText(TEXTS.withFormulasHint, { names: names.replaceAll(",", ", ") })}
          checked={isIncluded}
          onChange={(event) => setIncluded(event.currentTarget.checked)}
        />
      )}
      <Button
        component="a"
        href={`./api/runs/${run}/bundle.zip`}
        download
        variant="default"
        leftSection={<TbDownload size={14} />}
        title={TEXTS.bundleHint}
      >
        {TEXTS.bundle}
      </Button>
      <Button
        component="a"
        href="./api/runs/foxglove-layout.json"
        download
        variant="default"
        leftSection={<TbDownload size={14} />}
        title={TEXTS.layoutHint}
      >
        {TEXTS.layout}
      </Button>
    </>
  );
}

/** Report of several runs, in their order. */

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
        {TEXTS.reportHtml}
      </Button>
      <Button component="a" href={address("pdf")} download variant="default" size="xs">
        {TEXTS.reportPdf}
      </Button>
    </>
  );
}
